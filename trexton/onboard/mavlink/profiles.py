"""How PX4 and ArduPilot want to be told a position."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from trexton.base.errors import ParameterError
from trexton.onboard.fix import Fix
from trexton.onboard.local import LocalFrame
from trexton.onboard.mavlink.messages import odometry, quality, vision_position

__all__ = ["ArduPilot", "Profile", "Px4", "profile_named"]


@dataclass(frozen=True)
class Profile:
    """One autopilot's manner.

    Attributes
    ----------
    local : LocalFrame
    area : (x_min, x_max, y_min, y_max)
    """

    local: LocalFrame
    area: tuple[float, float, float, float]

    repeat_rate = 0.0  # messages a second, by repeating; 0 sends each position once
    unset = 0.0  # what stands in a command for "choose yourself"
    needs_attitude = False

    def position(self, fix: Fix, stamp_us: int, covariance: np.ndarray, attitude: Any) -> Any:
        """The message for a usable fix."""
        raise NotImplementedError

    def failed(self, fix: Fix, stamp_us: int, attitude: Any) -> Any:
        """The message that says there is no position, or None where silence says it."""
        return None


class Px4(Profile):
    """VISION_POSITION_ESTIMATE at a steady 30 Hz; silence, which ends its fusion, for no
    position."""

    name = "px4"
    repeat_rate = 30.0
    unset = math.nan

    def position(self, fix: Fix, stamp_us: int, covariance: np.ndarray, attitude: Any) -> Any:
        """The message for a usable fix."""
        return vision_position(
            stamp_us, fix.told.position, covariance, attitude, self.local, fix.resets
        )


class ArduPilot(Profile):
    """ODOMETRY, once an estimate, with a quality: -1 while there is no position."""

    name = "ardupilot"
    needs_attitude = True

    def position(self, fix: Fix, stamp_us: int, covariance: np.ndarray, attitude: Any) -> Any:
        """The message for a usable fix."""
        grade = quality(np.sqrt(np.diagonal(fix.covariance)), self.area)
        return odometry(
            stamp_us, fix.told.position, covariance, attitude, self.local, fix.resets, grade
        )

    def failed(self, fix: Fix, stamp_us: int, attitude: Any) -> Any:
        """The filter's position, marked as failed."""
        return odometry(
            stamp_us, fix.position, fix.covariance, attitude, self.local, fix.resets, -1
        )


PROFILES: dict[str, type[Profile]] = {"px4": Px4, "ardupilot": ArduPilot}


def profile_named(name: str, local: LocalFrame, area: tuple[float, float, float, float]) -> Profile:
    """The profile called `name`."""
    if name not in PROFILES:
        raise ParameterError(f"autopilot {name!r} is unknown: choose one of {', '.join(PROFILES)}")
    return PROFILES[name](local, area)
