"""Crazyflie: external positions as CRTP packets. They go by radio, cable or network (cflib)."""

from __future__ import annotations

import math
import queue
import re
import threading
import time
from contextlib import suppress
from typing import Any

from trexton.base.errors import ParameterError
from trexton.base.options import Options
from trexton.onboard.fix import STALE_AFTER, Fix, LocalFrame, largest_deviation
from trexton.onboard.sinks import Sink, Surroundings

FLOAT = 0x06  # of a parameter, as the protocol numbers types
DEVIATION = "locSrv.extPosStdDev"  # metres; as delivered 0.01, which no position here deserves
Item = tuple[list[float], float, float]  # a place, its deviation, and when it was put there
CHANGED = 1.2  # ratio of deviations from which on the parameter is sent anew
REPEATED_S = 1.0  # also then: a packet is lost, and a vehicle that starts anew has its own again


class CrazyflieSink(Sink):
    """East, north and height of each image, and before it how far the position may be off. The
    radio may make it wait: a thread connects and hands over the newest, and nothing else waits.

    The link is cflib's; its tables of parameters and its setpoints stay untouched, so that whoever
    flies the vehicle over the same radio goes on doing so.

    Raises
    ------
    ModuleNotFoundError
        The extra is not installed.
    """

    autopilot = True
    addresses = {"crazyflie:URI": "a Crazyflie, as in `crazyflie:radio://0/80/2M/E7E7E7E7E7`"}

    def __init__(self, uri: str, local: LocalFrame):
        import logging  # slow to load, and asked for by cflib alone

        from cflib import crtp
        from cflib.crazyflie import Crazyflie

        logging.getLogger("cflib").setLevel(logging.ERROR)
        self.name, self._uri, self._local = f"crazyflie:{uri}", uri, local
        self._crtp, self._new_vehicle = crtp, Crazyflie
        self._newest: queue.Queue[Item | None] = queue.Queue(maxsize=1)
        self._why = ""  # it failed last, for `write` to raise

    @classmethod
    def make(cls, address: str, options: Options, around: Surroundings) -> CrazyflieSink:
        if not re.match(r"\w+://.", address):
            raise ParameterError(
                f"output 'crazyflie:{address}': give crazyflie:URI, as in crazyflie:radio://0/80/2M"
            )
        return cls(address, around.local)

    def open(self) -> None:
        self._why, self._newest = "", queue.Queue(maxsize=1)
        args = (self._newest,)
        threading.Thread(target=self._run, args=args, name=self.name, daemon=True).start()

    def write(self, fix: Fix) -> None:
        if self._why:
            raise OSError(self._why)
        if fix.usable and fix.observed:
            place = self._local.enu(fix.fusion.position).tolist()
            self._put((place, largest_deviation(fix.fusion.covariance), time.monotonic()))

    def close(self) -> None:
        self._put(None)

    def _put(self, item: Item | None) -> None:
        with suppress(queue.Empty):
            self._newest.get_nowait()
        with suppress(queue.Full):  # never by one writer
            self._newest.put_nowait(item)

    def _run(self, newest: queue.Queue[Item | None]) -> None:
        """Connect, send and close: a radio may take seconds for each."""
        link: Any = None

        def failed(why: str) -> None:
            if newest is self._newest:  # of an earlier connection nothing is news
                self._why = why or "gone"

        try:
            if not self._crtp.CLASSES:
                self._crtp.init_drivers(enable_serial_driver=True)
            link = self._crtp.get_link_driver(self._uri, None, failed)
            if link is None:
                raise OSError("no driver of cflib knows this address")
            # A new one: the lock of one whose link failed while it sent stays closed.
            self._send(self._new_vehicle(), link, newest)
        except Exception as error:  # of whatever kind a driver raises
            failed(getattr(error, "strerror", None) or str(error))
        finally:
            if link is not None:
                link.close()

    def _send(self, vehicle: Any, link: Any, newest: queue.Queue[Item | None]) -> None:
        vehicle.link, sent, sent_at = link, math.nan, -math.inf  # the deviation, and when
        while (item := newest.get()) is not None:
            place, deviation, since = item
            if time.monotonic() - since > STALE_AFTER:  # the radio made it wait too long
                continue
            same = 1 / CHANGED < deviation / sent < CHANGED
            if not same or time.monotonic() - sent_at >= REPEATED_S:
                vehicle.param.set_value_raw(DEVIATION, FLOAT, deviation)
                sent, sent_at = deviation, time.monotonic()
            vehicle.loc.send_extpos(place)
