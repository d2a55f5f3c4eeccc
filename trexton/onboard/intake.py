"""What is done with a frame before it is localized: its picture is checked for faults of the
camera; attitude, height and velocity of the same moment are gathered."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from trexton.flights.aiding import Aiding
from trexton.onboard.sinks import Guard
from trexton.onboard.sources import Frame

__all__ = ["AIDS", "Aids", "Inspector"]

SAMPLE_STRIDE = 8  # one pixel in 64 tells black from white and one frame from the next
BLACK_LEVEL, WHITE_LEVEL = 12, 243  # grey levels, of 255
SATURATED_SHARE = 0.98  # of the pixels, from which on a frame is dark or bright
AIDS = ("tilt", "all", "none")
_STAMPED = {  # what shares a stamp
    "attitude_time": ("roll", "pitch", "yaw"),
    "height_time": ("height",),
    "velocity_time": ("velocity", "velocity_sigma"),
}


class Inspector:
    """Names the fault of a frame, or None.

    Parameters
    ----------
    shape : (rows, columns) or None
        The map's image size; None where the map was trained on histograms.
    """

    def __init__(self, shape: tuple[int, int] | None):
        self.shape = shape
        self._last: np.ndarray | None = None

    def check(self, picture: np.ndarray) -> str | None:
        """The fault of an ``(H, W, 3) uint8`` image; a histogram has none."""
        if picture.ndim == 1:
            return None
        if self.shape is not None and picture.shape[:2] != self.shape:
            return "size"
        sample = picture[::SAMPLE_STRIDE, ::SAMPLE_STRIDE].copy()
        # Sensor noise alone makes two frames differ: equal bytes mean that the camera
        # repeats itself.
        same = self._last is not None and np.array_equal(sample, self._last)
        self._last = sample
        luma = sample[..., 0]
        if np.mean(luma <= BLACK_LEVEL) >= SATURATED_SHARE:
            return "dark"
        if np.mean(luma >= WHITE_LEVEL) >= SATURATED_SHARE:
            return "bright"
        return "frozen" if same else None


class Aids:
    """Gathers what the recording and the autopilots say of a frame's moment.

    Parameters
    ----------
    wanted : {"tilt", "all", "none"}
        Roll, pitch and height; yaw and velocity as well, which take a compass; nothing.
    sinks : sequence of Guard
        Asked in turn for what the frame does not bring itself.
    """

    def __init__(self, wanted: str, sinks: Sequence[Guard]):
        self.wanted, self._sinks = wanted, sinks

    def of(self, frame: Frame, stamp: float) -> Aiding | None:
        """The aiding at `stamp`, the frame's on the clock of the loop; None where there is none."""
        if self.wanted == "none":
            return None
        aiding = self.everything(frame, stamp)
        aiding = aiding if self.wanted == "all" else aiding.without_heading()
        return aiding if any(getattr(aiding, stamp) is not None for stamp in _STAMPED) else None

    def everything(self, frame: Frame, stamp: float) -> Aiding:
        """All aiding at `stamp`, whatever is wanted."""
        said = [] if frame.aiding is None else [frame.aiding.shifted(stamp - frame.time)]
        said += [each for guard in self._sinks if (each := guard.sink.aiding(stamp)) is not None]
        aiding = Aiding()
        for each in said:  # attitude, height and velocity each of the first who knows it
            lacking = [stamp for stamp in _STAMPED if getattr(aiding, stamp) is None]
            names = [name for stamp in lacking for name in (stamp, *_STAMPED[stamp])]
            known = each.at(stamp)
            aiding = replace(aiding, **{name: getattr(known, name) for name in names})
        return aiding
