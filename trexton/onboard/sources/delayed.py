"""A camera whose frames are old when they arrive: exposure, transfer and decoding take time."""

from __future__ import annotations

from dataclasses import replace

from trexton.onboard.sources.base import Frame, Source

__all__ = ["Delayed"]


class Delayed(Source):
    """Stamps the frames of a live source with when they were taken, not with when they arrived.

    Parameters
    ----------
    source : Source
    delay : float
        Seconds in between.
    """

    def __init__(self, source: Source, delay: float):
        self.source, self.delay, self.live = source, delay, source.live
        self.gives, self.files, self.reopens = source.gives, source.files, source.reopens

    def open(self) -> None:
        self.source.open()

    def read(self) -> Frame | None:
        frame = self.source.read()
        if frame is None:
            return None
        aiding = None if frame.aiding is None else frame.aiding.shifted(-self.delay)
        return replace(frame, time=frame.time - self.delay, aiding=aiding)

    def close(self) -> None:
        self.source.close()
