"""One autopilot's manner each (`Profile`): which messages carry a position, and which say that
there is none. `PROFILES` has them by the name that is typed."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import numpy as np

from trexton.onboard.fix import Fix
from trexton.onboard.local import LocalFrame
from trexton.onboard.mavlink.messages import (
    Report,
    gps_input,
    landing_target,
    odometry,
    quality,
    vision_position,
)

__all__ = ["PROFILES", "Profile"]


@dataclass(frozen=True, eq=False)
class Profile:
    """One autopilot's manner.

    Attributes
    ----------
    local : LocalFrame
    area : (x_min, x_max, y_min, y_max)
    origin : (latitude, longitude, altitude) or None
    target : (2,) array or None
        Centre of the landing zone in metres on the map, where it is to be sent.
    """

    local: LocalFrame
    area: tuple[float, float, float, float]
    origin: tuple[float, float, float] | None = None
    target: np.ndarray | None = None

    unset = 0.0  # what stands in a command for "choose yourself"
    needs_attitude = False
    needs_yaw = False  # whether no position may go out without a yaw, where ours is fused
    sees_from_body = True  # whether LANDING_TARGET is the way there, not the place

    def position(self, fix: Fix, report: Report) -> Any:
        """The message for a usable fix."""
        raise NotImplementedError

    def failed(self, fix: Fix, report: Report) -> Any:
        """The message that says there is no position; None where silence says it."""
        return None

    def zone(self, report: Report) -> Any:
        """The message that says where the landing zone is; None where it is not to be sent."""
        if self.target is None or report.attitude is None:
            return None
        return landing_target(report, self.local, self.target, self.sees_from_body)


class Px4(Profile):
    """VISION_POSITION_ESTIMATE; silence, which ends its fusion, for no position."""

    unset = math.nan
    sees_from_body = False

    def position(self, fix: Fix, report: Report) -> Any:
        return vision_position(report, self.local)


class ArduPilot(Profile):
    """ODOMETRY with a quality: -1 while there is no position, which then is the filter's."""

    needs_attitude = needs_yaw = True

    def position(self, fix: Fix, report: Report) -> Any:
        grade = quality(np.sqrt(np.diagonal(fix.covariance)), self.area)
        return odometry(report, self.local, grade)

    def failed(self, fix: Fix, report: Report) -> Any:
        return odometry(report, self.local, -1)


class ArduPilotGps(Profile):
    """GPS_INPUT, for who takes a position from a receiver alone; without a fix while there is
    none."""

    def position(self, fix: Fix, report: Report) -> Any:
        return self._input(report, True)

    def failed(self, fix: Fix, report: Report) -> Any:
        return self._input(report, False)

    def _input(self, report: Report, fixed: bool) -> Any:
        assert self.origin is not None
        unix = time.time() - time.monotonic() + report.time
        return gps_input(report, self.local, self.origin, unix, fixed)


PROFILES: dict[str, type[Profile]] = {
    "px4": Px4,
    "ardupilot": ArduPilot,
    "ardupilot-gps": ArduPilotGps,
}
