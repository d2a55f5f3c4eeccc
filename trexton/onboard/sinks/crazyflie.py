"""Crazyflie: external positions as CRTP packets, by radio, cable or network as cflib knows them."""

from __future__ import annotations

import logging
import math
import re
from typing import Any

from trexton.base.errors import ParameterError
from trexton.base.options import Options
from trexton.onboard.fix import Fix
from trexton.onboard.local import LocalFrame, largest_deviation
from trexton.onboard.sinks.base import NewestSink, Surroundings, extra

__all__ = ["CrazyflieSink"]

FLOAT = 0x06  # of a parameter, as the protocol numbers types
DEVIATION = "locSrv.extPosStdDev"  # metres; as delivered 0.01, which no position here deserves
CHANGED = 1.2  # ratio of deviations from which on the parameter is sent anew


class CrazyflieSink(NewestSink):
    """East, north and height of each image, and before it how far the position may be off.

    The link is cflib's; its tables of parameters and its setpoints stay untouched, so that whoever
    flies the vehicle over the same radio goes on doing so.

    Raises
    ------
    ParameterError
        The extra is not installed.
    """

    autopilot = True
    addresses = {
        "crazyflie:URI": "a Crazyflie, as in `crazyflie:radio://0/80/2M/E7E7E7E7E7`",
    }

    def __init__(self, uri: str, local: LocalFrame):
        with extra("a Crazyflie", "cflib", "crazyflie"):
            from cflib import crtp
            from cflib.crazyflie import Crazyflie
        logging.getLogger("cflib").setLevel(logging.ERROR)
        self.name, self._uri, self._local = f"crazyflie:{uri}", uri, local
        self._crtp, self._vehicle = crtp, Crazyflie()
        self._deviation = math.nan  # as it was sent last

    @classmethod
    def make(cls, address: str, options: Options, around: Surroundings) -> CrazyflieSink:
        if not re.match(r"\w+://.", address):
            raise ParameterError(
                f"output 'crazyflie:{address}': give crazyflie:URI, as in "
                "crazyflie:radio://0/80/2M/E7E7E7E7E7"
            )
        return cls(address, around.local)

    def connect(self) -> None:
        if not self._crtp.CLASSES:
            self._crtp.init_drivers(enable_serial_driver=True)
        try:
            link = self._crtp.get_link_driver(self._uri, None, self.failed)
        except Exception as error:  # cflib says so where there is no radio
            raise OSError(str(error)) from None
        if link is None:
            raise OSError("no driver of cflib knows this address")
        self._vehicle.link, self._deviation = link, math.nan

    def made(self, fix: Fix) -> tuple[list[float], float]:
        fusion = fix.fusion
        return self._local.enu(fusion.position).tolist(), largest_deviation(fusion.covariance)

    def deliver(self, item: tuple[list[float], float]) -> None:
        place, deviation = item
        ratio = deviation / self._deviation
        if not 1 / CHANGED < ratio < CHANGED:
            self._vehicle.param.set_value_raw(DEVIATION, FLOAT, deviation)
            self._deviation = deviation
        self._vehicle.loc.send_extpos(place)

    def disconnect(self) -> None:
        link: Any = self._vehicle.link
        self._vehicle.link = None
        if link is not None:
            link.close()
