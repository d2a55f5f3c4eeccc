"""Paparazzi, the paper's own autopilot: REMOTE_GPS_LOCAL on its Ivy bus.

The fields are those of the datalink message in Paparazzi's message definitions: aircraft, padding,
east, north, up in metres, their speeds, time of week in milliseconds, course in degrees. Speeds and
course are zero: nothing measures them, and the message knows no "unknown", so the aircraft must not
be set to use them.
"""

from __future__ import annotations

import logging
import re
from typing import Any

from trexton.base.errors import ParameterError
from trexton.base.options import Options
from trexton.onboard.fix import Fix
from trexton.onboard.local import LocalFrame
from trexton.onboard.sinks.base import NewestSink, Surroundings, extra

__all__ = ["PaparazziSink", "remote_gps_local"]

BUS = "127.255.255.255:2010"  # Paparazzi's own default
WEEK_MS = 7 * 24 * 3600 * 1000


def remote_gps_local(fix: Fix, aircraft: int, local: LocalFrame) -> str:
    """The message as the bus carries it: class, name, fields."""
    east, north, up = local.enu(fix.position)
    tow = round(1000 * fix.time) % WEEK_MS
    place = f"{east:.4f} {north:.4f} {up:.4f}"
    return f"datalink REMOTE_GPS_LOCAL {aircraft} 0 {place} 0.0 0.0 0.0 {tow} 0.0"


class PaparazziSink(NewestSink):
    """The bus finds its readers itself, whenever they come; one that sleeps makes it wait. Two
    agents that find each other at the same moment connect twice, and hear each position twice.

    Raises
    ------
    ParameterError
        The extra is not installed.
    """

    autopilot = True
    addresses = {
        "paparazzi:AIRCRAFT": f"Paparazzi's Ivy bus at {BUS}",
        "paparazzi:AIRCRAFT@BUS": "the same on another bus, as in `7@192.168.1.255:2010`",
    }

    def __init__(self, aircraft: int, local: LocalFrame, bus: str = BUS):
        with extra("Paparazzi", "ivy-python", "paparazzi"):
            from ivy.ivy import IvyServer
        logging.getLogger("Ivy").setLevel(logging.ERROR)
        self.name = f"paparazzi:{aircraft}"
        self._make_server: Any = IvyServer
        self._server: Any = None
        self._aircraft, self._local, self._bus = aircraft, local, bus

    @classmethod
    def make(cls, address: str, options: Options, around: Surroundings) -> PaparazziSink:
        number, _, bus = address.partition("@")
        if not number.isdecimal() or int(number) > 255 or not re.fullmatch(r"([\d.]+:\d+)?", bus):
            raise ParameterError(
                f"output 'paparazzi:{address}': give paparazzi:AIRCRAFT, a number from 0 to 255, "
                f"and @BUS where it is not {BUS}"
            )
        return cls(int(number), around.local, bus or BUS)

    def connect(self) -> None:
        self._server = self._make_server("trexton", "trexton ready", usesDaemons=True)
        self._server.start(self._bus)

    def made(self, fix: Fix) -> str:
        return remote_gps_local(fix, self._aircraft, self._local)

    def deliver(self, item: str) -> None:
        self._server.send_msg(item)

    def disconnect(self) -> None:
        if self._server.isAlive():
            self._server.stop()
        self._server.server_close()
