"""What stands between a perfect picture of the floor and a camera's frame: each a number, 0 for
off.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np

from trexton.base.errors import ParameterError

__all__ = ["Effects", "Light"]


@dataclass(frozen=True)
class Effects:
    """Strength of each effect; the defaults are those of a small quadrotor indoors, 0 switches one
    off.

    Attributes
    ----------
    roll_pitch : float
        Share of the vehicle's tilt that the camera sees; 0 is a camera that is kept level.
    yaw : float
        Standard deviation of the heading in radians.
    height_ripple : float
        Standard deviation of the height in metres.
    motion_blur : float
        Exposure time in seconds, over which the true motion smears the frame.
    rolling_shutter : float
        Seconds between the readout of the first and of the last row.
    exposure : float
        Standard deviation of the slow changes of the camera's gain, as a share.
    vignetting : float
        Share of the light that is lost in the corners.
    noise : float
        Standard deviation of the sensor's noise at mid grey, in grey levels.
    chroma_subsampling : float
        1: two pixels in a row share U and V (4:2:2), as the camera delivers them.
    jpeg : float
        Quality of the JPEG files, 1 to 100; off, files are lossless PNG.
    """

    roll_pitch: float = 1.0
    yaw: float = 0.03
    height_ripple: float = 0.03
    motion_blur: float = 0.010
    rolling_shutter: float = 0.025
    exposure: float = 0.02
    vignetting: float = 0.25
    noise: float = 2.5
    chroma_subsampling: float = 1.0
    jpeg: float = 92

    _LIMITS = {
        "roll_pitch": 1.0,
        "yaw": 0.5,
        "height_ripple": 0.2,
        "motion_blur": 0.04,
        "rolling_shutter": 0.08,
        "exposure": 0.3,
        "vignetting": 0.9,
        "noise": 25.0,
        "chroma_subsampling": 1.0,
        "jpeg": 100.0,
    }

    def __post_init__(self) -> None:
        for name, limit in self._LIMITS.items():
            value = getattr(self, name)
            if not 0 <= value <= limit:
                raise ParameterError(f"effect {name} is {value}: expected 0 (off) to {limit:g}")

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """The names of all effects."""
        return tuple(field.name for field in fields(cls))

    @classmethod
    def none(cls) -> Effects:
        """Everything off: a perfect camera, level and at constant height."""
        return cls(**dict.fromkeys(cls.names(), 0.0))

    def without(self, *names: str) -> Effects:
        """These effects switched off, the others as they are."""
        if unknown := [name for name in names if name not in self.names()]:
            raise ParameterError(
                f"unknown effect {unknown[0]!r}: the effects are {', '.join(self.names())}"
            )
        return replace(self, **dict.fromkeys(names, 0.0))


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
