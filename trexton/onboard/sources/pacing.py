"""A recording played at its own stamps: then it behaves like a camera, and who is slow misses
frames."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from trexton.onboard.sources.base import Frame, Source

__all__ = ["Paced"]


class Paced(Source):
    """Holds each frame of a recording back until its time has come, and stamps it with the clock.

    Parameters
    ----------
    source : Source
        A recording.
    clock, sleep : callable
        Seconds.
    """

    live = True
    reopens = False  # a recording would begin anew

    def __init__(
        self,
        source: Source,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ):
        self.source, self._clock, self._sleep = source, clock, sleep
        self.gives, self.files = source.gives, source.files
        self._offset: float | None = None

    def open(self) -> None:
        self.source.open()

    def read(self) -> Frame | None:
        frame = self.source.read()
        if frame is None:
            return None
        if self._offset is None:
            self._offset = self._clock() - frame.time
        due = frame.time + self._offset
        self._sleep(max(0.0, due - self._clock()))
        now = self._clock()
        aiding = None if frame.aiding is None else frame.aiding.shifted(now - frame.time)
        return replace(frame, time=now, aiding=aiding)

    def close(self) -> None:
        self.source.close()
