"""Paparazzi, the paper's own autopilot: REMOTE_GPS_LOCAL on its Ivy bus.

The fields are those of the datalink message in Paparazzi's message definitions: aircraft, padding, east,
north, up in metres, their speeds, time of week in milliseconds, course in degrees. Speeds and course are
zero: nothing measures them, and the message knows no "unknown", so the aircraft must not be set to use them.
"""

from __future__ import annotations

import logging
import queue
import threading
from contextlib import suppress

from trexton.errors import ParameterError
from trexton.onboard.fix import Fix
from trexton.onboard.local import LocalFrame
from trexton.onboard.sinks.base import Sink, SinkOptions

__all__ = ["PaparazziSink", "make", "remote_gps_local"]

BUS = "127.255.255.255:2010"  # Paparazzi's own default
WEEK_MS = 7 * 24 * 3600 * 1000


def make(address: str, options: SinkOptions) -> Sink:
    """`address` is ``paparazzi:AIRCRAFT`` or ``paparazzi:AIRCRAFT@BUS``."""
    aircraft, _, bus = address.partition(":")[2].partition("@")
    if not aircraft.isdigit() or int(aircraft) > 255:
        raise ParameterError(
            f"output {address!r}: give paparazzi:AIRCRAFT, a number from 0 to 255, and @BUS where it is not {BUS}"
        )
    return PaparazziSink(int(aircraft), options.local, bus or BUS)


def remote_gps_local(fix: Fix, aircraft: int, local: LocalFrame) -> str:
    """The message as the bus carries it: class, name, fields."""
    east, north, up = local.enu(fix.position)
    tow = round(1000 * fix.time) % WEEK_MS
    return f"datalink REMOTE_GPS_LOCAL {aircraft} 0 {east:.4f} {north:.4f} {up:.4f} 0.0 0.0 0.0 {tow} 0.0"


class PaparazziSink(Sink):
    """Usable fixes that an image went into; the bus finds its readers itself, whenever they come.

    A reader that sleeps makes the bus wait: a thread does the waiting, and only the newest message is kept for it.

    Raises
    ------
    ParameterError
        The extra is not installed.
    """

    def __init__(self, aircraft: int, local: LocalFrame, bus: str = BUS):
        try:
            from ivy.ivy import IvyServer
        except ImportError:
            raise ParameterError(
                "Paparazzi needs the package ivy-python: pip install 'trexton[paparazzi]'"
            ) from None
        logging.getLogger("Ivy").setLevel(logging.ERROR)
        self.name = f"paparazzi:{aircraft}"
        self._make_server, self._aircraft, self._local, self._bus = IvyServer, aircraft, local, bus
        self._newest: queue.Queue[str | None] | None = None
        self._server = None
        self._readers = 0

    def open(self) -> None:
        self._server = self._make_server("trexton", "trexton ready", usesDaemons=True)
        self._server.start(self._bus)
        self._newest = queue.Queue(maxsize=1)
        threading.Thread(
            target=self._send, args=(self._server, self._newest), name=self.name, daemon=True
        ).start()

    def write(self, fix: Fix) -> None:
        if fix.usable and fix.observed:
            self._replace(remote_gps_local(fix, self._aircraft, self._local))

    def _replace(self, text: str | None) -> None:
        with suppress(queue.Empty):
            self._newest.get_nowait()
        with suppress(queue.Full):  # never by one writer
            self._newest.put_nowait(text)

    def _send(self, server, newest: queue.Queue) -> None:
        while (text := newest.get()) is not None:
            self._readers = server.send_msg(text)

    def status(self) -> str:
        return f"{self._readers} on the bus listen"

    def close(self) -> None:
        if self._server is not None:
            self._replace(None)
            if self._server.isAlive():
                self._server.stop()
            self._server.server_close()
            self._server = None
