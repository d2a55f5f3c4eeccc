"""Sources that change what another gives: its stamps, its pictures, its pace."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

from trexton.onboard.sources.base import Frame, Source
from trexton.vision.rectification import Rectification

__all__ = ["Delayed", "Paced", "Rectified", "Wrapped"]


class Wrapped(Source):
    """Another source; whoever derives from it changes its frames.

    Parameters
    ----------
    source : Source
    """

    def __init__(self, source: Source):
        self.source, self.live, self.delay = source, source.live, source.delay
        self.gives, self.files, self.reopens = source.gives, source.files, source.reopens
        self.rectified = source.rectified

    def open(self) -> None:
        self.source.open()

    def read(self) -> Frame | None:
        return self.source.read()

    def decoded(self, frame: Frame) -> Frame:
        return self.changed(self.source.decoded(frame))

    def changed(self, frame: Frame) -> Frame:
        """The frame as it is handed on."""
        return frame

    def close(self) -> None:
        self.source.close()


class Delayed(Wrapped):
    """Stamps the frames of a live camera with when they were taken, not with when they arrived:
    exposure, transfer and decoding take their time.

    Parameters
    ----------
    source : Source
    delay : float
        Seconds in between.
    """

    def __init__(self, source: Source, delay: float):
        super().__init__(source)
        self.delay = delay

    def changed(self, frame: Frame) -> Frame:
        aiding = None if frame.aiding is None else frame.aiding.shifted(-self.delay)
        return replace(frame, time=frame.time - self.delay, aiding=aiding)


class Rectified(Wrapped):
    """Undistorts, crops and scales the pictures of a camera as those that the map was learned from.

    Parameters
    ----------
    source : Source
    rectification : Rectification
        Pictures of another size than its camera's stay as they are.
    """

    def __init__(self, source: Source, rectification: Rectification):
        super().__init__(source)
        self.rectification = rectification

    def changed(self, frame: Frame) -> Frame:
        picture = frame.picture
        if picture is None or picture.shape[1::-1] != self.rectification.source:
            return frame
        return replace(frame, picture=self.rectification.apply(picture))


class Paced(Wrapped):
    """Plays a recording at its own stamps, like a camera: who is slow misses frames.

    Each frame is held back until its time has come, and stamped with the clock.

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
