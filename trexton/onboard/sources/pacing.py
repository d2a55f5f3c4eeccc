"""A recording played at its own stamps: then it behaves like a camera, and who is slow misses
frames."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from trexton.onboard.sources.base import Frame, Source
from trexton.onboard.sources.wrapped import Wrapped

__all__ = ["Paced"]


class Paced(Wrapped):
    """Holds each frame of a recording back until its time has come, and stamps it with the clock.

    Parameters
    ----------
    source : Source
        A recording.
    clock, sleep : callable
        Seconds.
    """

    def __init__(
        self,
        source: Source,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ):
        super().__init__(source)
        self.live, self.reopens = True, False  # a recording would begin anew
        self._clock, self._sleep = clock, sleep
        self._offset: float | None = None

    def changed(self, frame: Frame) -> Frame:
        if self._offset is None:
            self._offset = self._clock() - frame.time
        due = frame.time + self._offset
        self._sleep(max(0.0, due - self._clock()))
        now = self._clock()
        aiding = None if frame.aiding is None else frame.aiding.shifted(now - frame.time)
        return replace(frame, time=now, aiding=aiding)
