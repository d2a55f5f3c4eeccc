"""What stands between a perfect picture of the floor and a camera's frame. Offers `Effects`, each a
number with 0 for off, and the hall's `Light`."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from trexton.base.options import Options, option

__all__ = ["Effects", "Light"]


@dataclass(frozen=True)
class Effects(Options):
    """Strength of each effect, 0 for off; the defaults are those of a small quadrotor indoors."""

    roll_pitch: float = option(
        1.0, "share of the vehicle's tilt that the camera sees; 0 is kept level", low=0, high=1
    )
    yaw: float = option(0.03, "standard deviation of the heading in radians", low=0, high=0.5)
    height_ripple: float = option(
        0.03, "standard deviation of the height in metres", low=0, high=0.2
    )
    motion_blur: float = option(
        0.010, "exposure time in seconds, over which the true motion smears", low=0, high=0.04
    )
    rolling_shutter: float = option(
        0.025, "seconds between the readout of the first and of the last row", low=0, high=0.08
    )
    exposure: float = option(
        0.02, "deviation of the slow changes of the camera's gain, as a share", low=0, high=0.3
    )
    vignetting: float = option(
        0.25, "share of the light that is lost in the corners", low=0, high=0.9
    )
    noise: float = option(
        2.5, "deviation of the sensor's noise at mid grey, in grey levels", low=0, high=25
    )
    chroma_subsampling: float = option(
        1.0, "1: two pixels in a row share U and V (4:2:2), as a camera delivers", low=0, high=1
    )
    jpeg: float = option(
        92.0, "quality of the JPEG files, 1 to 100; off, files are lossless PNG", low=0, high=100
    )

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """The names of all effects."""
        return tuple(each.name for each in cls.declared())

    @classmethod
    def none(cls) -> Effects:
        """Everything off: a perfect camera, level and at constant height."""
        return cls(**dict.fromkeys(cls.names(), 0.0))

    def without(self, *names: str) -> Effects:
        """These effects switched off, the others as they are."""
        return replace(self, **self.checked(dict.fromkeys(names, 0.0), "a camera"))


@dataclass(frozen=True)
class Light:
    """The hall's light: brightness, colour and evenness.

    Attributes
    ----------
    gain : float
        Brightness.
    warmth : float
        Share by which red gains and blue loses.
    gradient : (float, float)
        Share by which the light grows from the middle of the floor to its right and to its far
        edge.
    """

    gain: float = 1.0
    warmth: float = 0.0
    gradient: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def later(cls) -> Light:
        """An hour later: the sun has moved on."""
        return cls(gain=0.97, warmth=0.02, gradient=(0.03, -0.02))

    def channel_gains(self) -> np.ndarray:
        """``(3,)`` factors of blue, green and red."""
        return self.gain * np.array([1 - self.warmth, 1.0, 1 + self.warmth])
