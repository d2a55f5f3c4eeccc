"""MAVLink messages from fixes: every field here, and why. Needs pymavlink.

A `Profile` is one autopilot's manner: which messages carry a position, and which say that there is
none. What PX4 and ArduPilot do with the fields was read in their sources; the book's page on
autopilots tells it.
"""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from hashlib import sha256
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.quaternion import QuaternionBase
from pymavlink.rotmat import Matrix3, Vector3

from trexton.localization.estimate import ignorance
from trexton.onboard.fix import Fix, LocalFrame, decoupled, largest_deviation

__all__ = ["PROFILES", "Codec", "Profile", "Report", "mavlink"]

NAN = math.nan
# Square metres: a height nobody measured must weigh nothing even if it is fused.
UNKNOWN_HEIGHT = 100.0
UNKNOWN_ANGLE = float(np.float32(math.pi**2))  # square radians
EARTH = 6_378_100.0  # radius in metres, as ArduPilot takes it
GPS_EPOCH = 315_964_800 - 18  # seconds: 6 January 1980 in Unix time, leap seconds since
WEEK = 604_800  # seconds
UNIX_OFFSET = time.time() - time.monotonic()  # seconds; a clock set in flight moves no receiver's
SATELLITES = 10  # as many as ArduPilot asks for before it flies by them
_VARIANCES = (0, 6, 11, 15, 18, 20)  # in the upper triangle of a 6x6 matrix, row by row


class Codec(mavlink.MAVLink):  # type: ignore[misc]
    """As pymavlink's, which takes the stamp of a message before it looks at who signed it."""

    behind = False  # whether our key came with stamps too old to be believed, of a clock never set

    def check_signature(self, message: bytearray, system: int, component: int) -> bool:
        """Whether a signed message counts."""
        signing = self.signing
        if sha256(signing.secret_key + message[:-6]).digest()[:6] != message[-6:]:
            return False
        known = (message[-13], system, component) in signing.stream_timestamps
        counts = bool(super().check_signature(message, system, component))
        self.behind |= not (counts or known)
        return counts


def rounded_up(value: float) -> float:
    """The nearest float32 that is not less: a variance must not shrink on the wire."""
    single = np.float32(value)
    return float(single if float(single) >= value else np.nextafter(single, np.float32(np.inf)))


def pose_covariance(
    covariance: np.ndarray, height: float, angles: Sequence[float], cross: float = NAN
) -> list[float]:
    """The 21 numbers of a pose's covariance.

    Parameters
    ----------
    covariance : (2, 2) array
        Of north and east, square metres; its correlation is added to both variances, for receivers
        fuse those alone.
    height, angles : float, (3,) sequence
        Variances of z and of roll, pitch and yaw; NaN for unknown.
    cross : float
        What stands where a covariance is unknown.
    """
    entries = [cross] * 21
    bound = decoupled(covariance)
    entries[1] = float(bound[0, 1])
    variances = (bound[0, 0], bound[1, 1], height, *angles)
    for place, variance in zip(_VARIANCES, variances, strict=True):
        entries[place] = rounded_up(variance)
    return entries


@dataclass(frozen=True, eq=False)
class Report:
    """What a message says of one moment."""

    time: float  # seconds of the steady clock
    position: np.ndarray  # (2,) metres, in the map's axes
    covariance: np.ndarray  # (2, 2) square metres
    attitude: tuple[float, float, float] | None  # its own roll, pitch, yaw
    resets: int = 0
    yaw: float = NAN  # ours, radians from north; NaN where it is not sent
    yaw_sigma: float = NAN  # its standard deviation

    @property
    def stamp_us(self) -> int:
        """Microseconds of the steady clock."""
        return round(1e6 * self.time)

    @property
    def angles(self) -> tuple[float, float, float]:
        """Roll, pitch and yaw, the yaw ours where it is sent; NaN where there is no attitude."""
        roll, pitch, yaw = self.attitude or (NAN, NAN, NAN)
        own = math.isfinite(self.yaw) and self.attitude is not None
        return roll, pitch, self.yaw if own else yaw


@dataclass(frozen=True, eq=False)
class Profile:
    """One autopilot's manner."""

    local: LocalFrame
    area: tuple[float, float, float, float]  # (x_min, x_max, y_min, y_max), metres
    origin: tuple[float, float, float] | None = None  # latitude, longitude, altitude
    target: np.ndarray | None = None  # (2,) centre of the landing zone on the map, where it is sent

    estimator = mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT  # says whether there is a position
    unset = 0.0  # what stands in a command for "choose yourself"
    needs_attitude = False
    needs_yaw = False  # whether no position may go out without a yaw, where ours is fused
    sees_from_body = True  # whether LANDING_TARGET is the way there, not the place

    def position(self, fix: Fix, report: Report, failed: bool = False) -> Any:
        """The message for a usable fix, or, `failed`, the one that says there is no position; None
        where silence says it.
        """
        raise NotImplementedError

    def zone(self, report: Report) -> Any:
        """LANDING_TARGET: where the landing zone lies; None where it is not to be sent.

        PX4 takes the place in local NED; ArduPilot the way there from the vehicle, in body axes.
        """
        if self.target is None or report.attitude is None:
            return None
        place = np.append(self.local.ned(self.target)[:2], 0.0)
        way = place - self.local.ned(report.position)
        distance = float(np.linalg.norm(way))
        frame = mavlink.MAV_FRAME_LOCAL_NED
        if self.sees_from_body:
            turn, frame = Matrix3(), mavlink.MAV_FRAME_BODY_FRD
            turn.from_euler(*report.attitude)
            seen = turn.transposed() * Vector3(*way.tolist())
            place = np.array([seen.x, seen.y, seen.z])
        return mavlink.MAVLink_landing_target_message(
            report.stamp_us, 0, frame, 0.0, 0.0, distance, 0.0, 0.0, *place, [1.0, 0.0, 0.0, 0.0],
            mavlink.LANDING_TARGET_TYPE_VISION_OTHER, 1,
        )  # fmt: skip


class Px4(Profile):
    """VISION_POSITION_ESTIMATE in local NED, the form in which PX4 takes a position as it is;
    silence, which ends its fusion, for no position.

    NaN goes out where there is no attitude. The variance of z is finite: PX4 uses no variance of
    ours unless all three are, and so with those of the angles, of which it fuses the yaw's alone.
    """

    estimator = mavlink.MAVLINK_MSG_ID_ESTIMATOR_STATUS
    unset = NAN
    sees_from_body = False

    def position(self, fix: Fix, report: Report, failed: bool = False) -> Any:
        if failed:
            return None
        north, east, down = self.local.ned(report.position)
        ned = self.local.ned_covariance(report.covariance)
        own = report.yaw_sigma**2
        angles = (UNKNOWN_ANGLE, UNKNOWN_ANGLE, own) if math.isfinite(own) else (NAN, NAN, NAN)
        matrix = pose_covariance(ned, UNKNOWN_HEIGHT, angles)
        return mavlink.MAVLink_vision_position_estimate_message(
            report.stamp_us, north, east, down, *report.angles, matrix, report.resets % 256
        )


class ArduPilot(Profile):
    """ODOMETRY in MAV_FRAME_LOCAL_FRD with a BODY_FRD child, the only form that ArduPilot takes;
    with a quality of -1 while there is no position, which then is the filter's.

    FRD is aligned with north: the map's heading is known. Velocities are NaN, for nothing measures
    them. ArduPilot makes one number of the three variances, of the position's as of the angles',
    and a NaN among the six would void the message, so all are finite.
    """

    needs_attitude = needs_yaw = True

    def position(self, fix: Fix, report: Report, failed: bool = False) -> Any:
        grade = -1 if failed else quality(np.sqrt(np.diagonal(fix.covariance)), self.area)
        north, east, down = self.local.ned(report.position)
        ned = self.local.ned_covariance(report.covariance)
        height = _folded(np.diagonal(decoupled(ned)))
        own, angles = report.yaw_sigma**2, [UNKNOWN_ANGLE] * 3
        if math.isfinite(own):
            angles = [0.0, _folded(np.array([own])), own]
        matrix = pose_covariance(ned, height, angles, cross=0.0)
        return mavlink.MAVLink_odometry_message(
            report.stamp_us, mavlink.MAV_FRAME_LOCAL_FRD, mavlink.MAV_FRAME_BODY_FRD,
            north, east, down, quaternion(*report.angles),
            NAN, NAN, NAN, NAN, NAN, NAN, matrix, [NAN] * 21, report.resets % 256,
            mavlink.MAV_ESTIMATOR_TYPE_VISION, grade,
        )  # fmt: skip


class ArduPilotGps(Profile):
    """GPS_INPUT, a receiver of satellites that is none: where on Earth the position lies; without a
    fix while there is none.

    Horizontal accuracy is the larger standard deviation; the dilution of precision repeats it, by
    which ArduPilot refuses to arm.
    """

    def position(self, fix: Fix, report: Report, failed: bool = False) -> Any:
        assert self.origin is not None
        north, east, down = self.local.ned(report.position)
        latitude, longitude, altitude = self.origin
        to_north = np.degrees(north / EARTH)
        to_east = np.degrees(east / (EARTH * math.cos(math.radians(latitude))))
        accuracy = largest_deviation(report.covariance)
        week, seconds = divmod(max(0.0, UNIX_OFFSET + report.time - GPS_EPOCH), WEEK)
        yaw = 0  # hundredths of a degree; 0 is unknown, and north is 36000
        if math.isfinite(report.yaw):
            yaw = round(100 * math.degrees(report.yaw)) % 36000 or 36000
        ignored = mavlink.GPS_INPUT_IGNORE_FLAG_VEL_HORIZ | mavlink.GPS_INPUT_IGNORE_FLAG_VEL_VERT
        ignored |= mavlink.GPS_INPUT_IGNORE_FLAG_SPEED_ACCURACY
        return mavlink.MAVLink_gps_input_message(
            report.stamp_us, 0, ignored, round(1000 * seconds), int(week),
            mavlink.GPS_FIX_TYPE_NO_FIX if failed else mavlink.GPS_FIX_TYPE_3D_FIX,
            round(1e7 * (latitude + to_north)),
            round(1e7 * ((longitude + to_east + 180) % 360 - 180)),
            altitude - down, accuracy, UNKNOWN_HEIGHT, 0.0, 0.0, 0.0, 0.0, accuracy,
            math.sqrt(UNKNOWN_HEIGHT), 0 if failed else SATELLITES, yaw,
        )  # fmt: skip


PROFILES: dict[str, type[Profile]] = {
    "px4": Px4,
    "ardupilot": ArduPilot,
    "ardupilot-gps": ArduPilotGps,
}


def _folded(variances: np.ndarray) -> float:
    """A variance beside these with which ArduPilot's error is not less than the largest of them.

    Its error is the root of the sum of the three variances now; in older firmware, the cube root of
    the sum of their squares.
    """
    return math.sqrt(max(0.0, variances.max() ** 1.5 - float(variances @ variances)))


def quality(spread: np.ndarray, area: tuple[float, float, float, float]) -> int:
    """ArduPilot's 1 (worst) to 100 from a spread; 1 is that of knowing nothing but the area."""
    return int(np.clip(round(100 * (1 - float(np.max(spread / ignorance(area))))), 1, 100))


def quaternion(roll: float, pitch: float, yaw: float) -> list[float]:
    """w, x, y, z of the rotation from body to local frame."""
    return QuaternionBase([roll, pitch, yaw]).q.tolist()
