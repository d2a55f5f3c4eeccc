"""MAVLink messages from fixes: every field here, and why. Needs pymavlink.

What PX4 and ArduPilot do with the fields was read in their sources; the book's page on autopilots
tells it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.quaternion import QuaternionBase

from trexton.localization.estimate import ignorance
from trexton.onboard.local import LocalFrame, decoupled

__all__ = [
    "ATTITUDE", "HEIGHT", "LANDED_STATE", "VELOCITY", "heartbeat", "interval_request", "land",
    "mavlink", "odometry", "origin", "pose_covariance", "quality", "quaternion",
    "vision_position",
]  # fmt: skip

NAN = math.nan
ATTITUDE = mavlink.MAVLINK_MSG_ID_ATTITUDE
LANDED_STATE = mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE
HEIGHT = mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR
VELOCITY = mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED
UNKNOWN_HEIGHT = (
    100.0  # square metres: a height nobody measured must weigh nothing even if it is fused
)
UNKNOWN_ANGLE = math.pi**2  # square radians
# Variances of roll, pitch, yaw in the upper triangle of a 6x6 matrix, row by row.
_ANGLES = (15, 18, 20)


def rounded_up(value: float) -> float:
    """The nearest float32 that is not less: a variance must not shrink on the wire."""
    single = np.float32(value)
    return float(single if float(single) >= value else np.nextafter(single, np.float32(np.inf)))


def pose_covariance(
    covariance: np.ndarray, height: float, angle: float, cross: float = NAN
) -> list[float]:
    """The 21 numbers of a pose's covariance.

    Parameters
    ----------
    covariance : (2, 2) array
        Of north and east, square metres; its correlation is added to both variances, for receivers
        fuse those alone.
    height, angle : float
        Variances of z and of each angle; NaN for unknown.
    cross : float
        What stands where a covariance is unknown.
    """
    entries = [cross] * 21
    bound = decoupled(covariance)
    entries[0], entries[1], entries[6] = (
        rounded_up(bound[0, 0]),
        float(bound[0, 1]),
        rounded_up(bound[1, 1]),
    )
    entries[11] = rounded_up(height)
    for place in _ANGLES:
        entries[place] = angle
    return entries


def vision_position(
    stamp_us: int,
    position: np.ndarray,
    covariance: np.ndarray,
    attitude: tuple[float, float, float] | None,
    local: LocalFrame,
    resets: int,
) -> Any:
    """VISION_POSITION_ESTIMATE in local NED, the form in which PX4 takes a position as it is.

    `attitude` is roll, pitch, yaw as the autopilot itself reports them; NaN goes out where there is
    none. The variance of z is finite: PX4 uses no variance of ours unless all three are.
    """
    north, east, down = local.ned(position)
    roll, pitch, yaw = attitude or (NAN, NAN, NAN)
    matrix = pose_covariance(local.ned_covariance(covariance), UNKNOWN_HEIGHT, NAN)
    return mavlink.MAVLink_vision_position_estimate_message(
        stamp_us, north, east, down, roll, pitch, yaw, matrix, resets % 256
    )


def odometry(
    stamp_us: int,
    position: np.ndarray,
    covariance: np.ndarray,
    attitude: tuple[float, float, float],
    local: LocalFrame,
    resets: int,
    quality: int,
) -> Any:
    """ODOMETRY in MAV_FRAME_LOCAL_FRD with a BODY_FRD child, the only form that ArduPilot takes.

    FRD is aligned with north: the map's heading is known. Velocities are NaN, for nothing measures
    them. ArduPilot makes one number of the three variances, and a NaN among the six would void the
    message, so all are finite.
    """
    north, east, down = local.ned(position)
    ned = local.ned_covariance(covariance)
    matrix = pose_covariance(ned, _folded_height(decoupled(ned)), UNKNOWN_ANGLE, cross=0.0)
    return mavlink.MAVLink_odometry_message(
        stamp_us, mavlink.MAV_FRAME_LOCAL_FRD, mavlink.MAV_FRAME_BODY_FRD, north, east, down,
        quaternion(*attitude),
        NAN, NAN, NAN, NAN, NAN, NAN, matrix, [NAN] * 21, resets % 256,
        mavlink.MAV_ESTIMATOR_TYPE_VISION, quality,
    )  # fmt: skip


def _folded_height(covariance: np.ndarray) -> float:
    """A variance for z with which ArduPilot's position error is not less than the larger of ours.

    It is the root of the sum of the three variances now; in older firmware, the cube root of the
    sum of their squares.
    """
    variances = np.diagonal(covariance)
    return math.sqrt(max(0.0, variances.max() ** 1.5 - float(variances @ variances)))


def quality(spread: np.ndarray, area: tuple[float, float, float, float]) -> int:
    """ArduPilot's 1 (worst) to 100 from a spread; 1 is that of knowing nothing but the area."""
    return int(np.clip(round(100 * (1 - float(np.max(spread / ignorance(area))))), 1, 100))


def quaternion(roll: float, pitch: float, yaw: float) -> list[float]:
    """w, x, y, z of the rotation from body to local frame."""
    numbers: list[float] = QuaternionBase([roll, pitch, yaw]).q.tolist()
    return numbers


def heartbeat() -> Any:
    """HEARTBEAT of an onboard computer, which is no autopilot."""
    kind, state = mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_STATE_ACTIVE
    return mavlink.MAVLink_heartbeat_message(kind, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, state, 3)


def origin(target: int, latitude: float, longitude: float, altitude: float, stamp_us: int) -> Any:
    """SET_GPS_GLOBAL_ORIGIN: where on Earth the map's origin lies, in degrees and metres above
    sea level."""
    degrees = [round(1e7 * angle) for angle in (latitude, longitude)]
    return mavlink.MAVLink_set_gps_global_origin_message(
        target, *degrees, round(1000 * altitude), stamp_us
    )


def land(target: tuple[int, int], confirmation: int, unset: float) -> Any:
    """COMMAND_LONG with MAV_CMD_NAV_LAND, here and now; `unset` stands for what the autopilot shall
    choose itself.

    PX4 takes NaN for that, ArduPilot zero.
    """
    return mavlink.MAVLink_command_long_message(
        *target, mavlink.MAV_CMD_NAV_LAND, confirmation, 0, 0, 0, unset, unset, unset, unset
    )


def interval_request(target: tuple[int, int], message: int, rate: float) -> Any:
    """COMMAND_LONG that asks for a message, by its number, `rate` times a second."""
    return mavlink.MAVLink_command_long_message(
        *target, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, 0, message, 1e6 / rate, *[0] * 5
    )
