"""What the autopilot knows beside a frame: attitude, height and velocity, each with its stamp.

`Aiding` is handed to a filter with the frame; `Aiding.at` leaves out what is not of that moment.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from trexton.base.errors import ParameterError

# Seconds from the frame: a vehicle in a gust tilts by degrees in a tenth of a second; its height
# and velocity change more slowly.
ATTITUDE_AGE, OTHER_AGE = 0.1, 0.3


@dataclass(frozen=True, eq=False)
class Aiding:
    """What the autopilot knows besides; every part is optional and carries its own stamp. Angles
    and heights that are not finite are taken as not known.

    Attributes
    ----------
    roll, pitch, yaw : float or None
        Radians, as in `trexton.vision.camera`: yaw is anticlockwise, 0 where the nose points along
        the map's y axis.
    height : float or None
        Metres above the floor.
    velocity : (2,) array or None
        Metres a second, in the map's axes.
    velocity_sigma : float or None
        Its standard deviation along an axis; None where the filter's own doubt holds.
    attitude_time, height_time, velocity_time : float or None
        Seconds on the clock that stamps the frames.
    """

    roll: float | None = None
    pitch: float | None = None
    yaw: float | None = None
    height: float | None = None
    velocity: np.ndarray | None = None
    attitude_time: float | None = None
    height_time: float | None = None
    velocity_time: float | None = None
    velocity_sigma: float | None = None

    def __post_init__(self) -> None:
        for name in ("roll", "pitch", "yaw", "height"):  # of a velocity the filter says it
            if (value := getattr(self, name)) is not None and not np.isfinite(value):
                object.__setattr__(self, name, None)
        if np.ma.is_masked(self.velocity):
            object.__setattr__(self, "velocity", None)
        if self.velocity is not None and (shape := np.shape(self.velocity)) != (2,):
            raise ParameterError(f"a velocity of shape {shape} was given: expected (2,), x and y")

    def at(self, time: float) -> Aiding:
        """Only what is of that moment: what bears no stamp, or one too far from `time`, is left
        out."""
        angles = (self.roll, self.pitch, self.yaw)
        attitude = _near(self.attitude_time, time, ATTITUDE_AGE) and angles != (None, None, None)
        height = _near(self.height_time, time, OTHER_AGE) and self.height is not None
        finite = self.velocity is not None and bool(np.isfinite(self.velocity).all())
        velocity = finite and _near(self.velocity_time, time, OTHER_AGE)
        return Aiding(
            *(angles if attitude else (None, None, None)),
            self.height if height else None, self.velocity if velocity else None,
            self.attitude_time if attitude else None, self.height_time if height else None,
            self.velocity_time if velocity else None,
            self.velocity_sigma if velocity else None,
        )  # fmt: skip

    def only(self, names: Iterable[str]) -> Aiding:
        """The parts of these names alone, without stamps: of the moment of the frame."""
        return Aiding(**{name: getattr(self, name) for name in names})

    def shifted(self, seconds: float) -> Aiding:
        """The same on a clock that is ahead by so many seconds."""
        stamps = ("attitude_time", "height_time", "velocity_time")
        known = {name: stamp for name in stamps if (stamp := getattr(self, name)) is not None}
        return replace(self, **{name: stamp + seconds for name, stamp in known.items()})

    def without_heading(self) -> Aiding:
        """The same without yaw and velocity, which are only as good as the compass."""
        return replace(self, yaw=None, velocity=None, velocity_time=None, velocity_sigma=None)


def _near(stamp: float | None, time: float, most: float) -> bool:
    return stamp is not None and abs(stamp - time) <= most
