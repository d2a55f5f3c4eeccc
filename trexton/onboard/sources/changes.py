"""What is done to the frames of another source: stamps set back, pictures rectified (`Delay`,
`Rectify`), a recording held to its own pace (`Paced`)."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

from trexton.onboard.sources.base import Frame, Source
from trexton.vision.rectification import Rectification

__all__ = ["Delay", "Paced", "Rectify"]


@dataclass(frozen=True)
class Delay:
    """Stamps a live camera's frame with when it was taken, so many seconds before it arrived:
    exposure, transfer and decoding take their time.
    """

    seconds: float

    def __call__(self, frame: Frame) -> Frame:
        aiding = None if frame.aiding is None else frame.aiding.shifted(-self.seconds)
        return replace(frame, time=frame.time - self.seconds, aiding=aiding)


@dataclass(frozen=True)
class Rectify:
    """Undistorts, crops and scales a camera's picture as those that the map was learned from; one
    of another size than the camera's stays as it is.
    """

    rectification: Rectification

    def __call__(self, frame: Frame) -> Frame:
        picture = frame.picture
        if picture is None or picture.shape[1::-1] != self.rectification.source:
            return frame
        return replace(frame, picture=self.rectification.apply(picture))


class Paced(Source):
    """Plays a recording at its own stamps, like a camera: who is slow misses frames.

    Each frame is held back until its time has come, and stamped with the clock.

    Parameters
    ----------
    source : Source
        A recording.
    clock, sleep : callable
        Seconds.
    """

    reopens = False  # a recording would begin anew

    def __init__(
        self,
        source: Source,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ):
        self.source, self.gives, self.files = source, source.gives, source.files
        self.rectified = source.rectified
        self.open, self.close = source.open, source.close  # type: ignore[method-assign]
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
