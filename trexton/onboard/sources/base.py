"""What every source of frames is: open, read one frame after another, close."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from trexton.errors import TrextonError

__all__ = ["CameraLost", "Frame", "Source", "SourceOptions"]


class CameraLost(TrextonError):
    """The source gives no more frames, but may do so again once it is opened anew."""


@dataclass(frozen=True, eq=False, slots=True)
class Frame:
    """One frame as it came.

    Attributes
    ----------
    time : float
        Seconds at which it was captured.
    picture : (H, W, 3) uint8 array, (K,) array or None
        Image (Y, U, V) or histogram; None where it came but cannot be decoded.
    """

    time: float
    picture: np.ndarray | None


@dataclass(frozen=True)
class SourceOptions:
    """What a source may need to know beside its address.

    Attributes
    ----------
    shape : (rows, columns) or None
        The image size to ask the camera for.
    period_s : float
        Seconds from frame to frame where the source itself does not say.
    pace : {"fast", "stamps", None}
        A recording as fast as possible, every frame; or at its own stamps, like a live camera. None leaves it
        to the source: recordings go fast, the simulator keeps time.
    laps : int
        Times a recording is played.
    seed : int
        Of the simulator.
    """

    shape: tuple[int, int] | None = None
    period_s: float = 0.08
    pace: str | None = None
    laps: int = 1
    seed: int = 1


class Source(ABC):
    """A camera, or something that stands for one.

    A live source makes its own time: it is read in a thread, and only its newest frame counts. Any other is
    read frame by frame by whoever works on them, so that nothing is left out.
    """

    live = True

    @abstractmethod
    def open(self) -> None:
        """Begin, or begin again after a fault; raises `CameraLost` where there is nothing to open."""

    @abstractmethod
    def read(self) -> Frame | None:
        """The next frame, or None after the last; raises `CameraLost` where opening again may help."""

    def close(self) -> None:
        """Let go of the device or file."""
