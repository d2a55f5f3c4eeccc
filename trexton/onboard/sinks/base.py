"""What every sink of positions is, and the guard that keeps a failing one from stopping the rest."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from trexton.onboard.fix import Fix
from trexton.onboard.local import LocalFrame
from trexton.onboard.tally import Tally
from trexton.progress import say

__all__ = ["Guard", "Sink", "SinkOptions"]

FIRST_PAUSE, LONGEST_PAUSE = 1.0, 30.0


@dataclass(frozen=True)
class SinkOptions:
    """What a sink may need to know beside its address.

    Attributes
    ----------
    local : LocalFrame
        How the map lies on the ground.
    autopilot : {"px4", "ardupilot"}
    origin : (latitude, longitude, altitude) or None
        Degrees and metres of the map's origin, to be set as the autopilot's; None sets none.
    area : (x_min, x_max, y_min, y_max)
        The map's area in metres.
    motion_rate : (2, 2) array
        Covariance that the motion model adds in a second, square metres.
    tally : Tally
    """

    local: LocalFrame
    autopilot: str
    origin: tuple[float, float, float] | None
    area: tuple[float, float, float, float]
    motion_rate: np.ndarray
    tally: Tally


class Sink(ABC):
    """Takes one fix after another; may raise `OSError` except in its constructor: `Guard` sees to it."""

    name = "output"

    @abstractmethod
    def open(self) -> None:
        """Begin, or begin again after a fault."""

    @abstractmethod
    def write(self, fix: Fix) -> None:
        """Take one fix."""

    def event(self, event: dict) -> None:
        """Take something worth remembering that is no fix: a command, an answer, a count."""

    def news(self) -> list[dict]:
        """What has happened on the other side since this was last asked, as events for the log."""
        return []

    def status(self) -> str:
        """A few words for the status line."""
        return ""

    def close(self) -> None:
        """Let go of file or connection."""


class Guard:
    """A sink that may fail: counted, closed, and opened again after a pause that doubles up to
    `LONGEST_PAUSE`.

    Parameters
    ----------
    sink : Sink
    tally : Tally
    clock : callable
        Seconds.
    """

    def __init__(self, sink: Sink, tally: Tally, clock: Callable[[], float] = time.monotonic):
        self.sink, self._tally, self._clock = sink, tally, clock
        self._open, self._pause, self._retry_at = False, FIRST_PAUSE, -np.inf

    def write(self, fix: Fix) -> None:
        """Pass the fix on, if the sink works."""
        self._try(lambda: self.sink.write(fix))

    def event(self, event: dict) -> None:
        """Pass the event on, if the sink works."""
        self._try(lambda: self.sink.event(event))

    def _try(self, act: Callable[[], None]) -> None:
        now = self._clock()
        if not self._open and now < self._retry_at:
            return
        try:
            if not self._open:
                self.sink.open()
                self._open = True
            act()
            self._pause = FIRST_PAUSE
        except OSError as error:
            self._tally.fault("output")
            say(
                f"trexton onboard: {self.sink.name}: {error.strerror or error}: trying again in {self._pause:g} s"
            )
            self._retry_at = now + self._pause
            self._pause = min(2 * self._pause, LONGEST_PAUSE)
            self._open = False
            self._close()

    def close(self) -> None:
        """Close the sink, whatever state it is in."""
        if self._open:
            self._open = False
            self._close()

    def _close(self) -> None:
        try:
            self.sink.close()
        except OSError:
            pass
