"""Attitudes from the quaternions of other systems, whose axes are named, given or guessed.

`AXES` has the usual ones; `camera_attitude` takes them by name, `attitude_from_quaternions` by
matrix.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.options import option

__all__ = ["AXES", "attitude_from_quaternions", "axes_option", "camera_attitude"]

# What a quaternion may turn, to the world, z up: right, forward and up of this project's vehicle
# (`trexton.vision.camera`), as columns in those axes.
AXES = {
    "rfu": np.eye(3),
    "flu": np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),  # REP 103
    "frd": np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]),
    "camera": np.diag([1.0, -1, -1]),
}


def axes_option() -> str:
    """What an importer of quaternions declares; see `camera_attitude`."""
    return option(
        "auto",
        "axes that the quaternions turn: camera (right, down, ahead), flu (forward, left, up), "
        "frd, rfu; auto: camera where that looks down, else flu",
        choices=("auto", *AXES),
    )


def attitude_from_quaternions(
    quaternions: Sequence[Sequence[float]] | np.ndarray, axes: np.ndarray = AXES["rfu"]
) -> np.ndarray:
    """``(N, 3)`` roll, pitch, yaw as `trexton.vision.camera` defines them, from ``(N, 4)`` x, y, z,
    w.

    Parameters
    ----------
    quaternions : (N, 4) array
        They take the source's axes to the world's. Where one is not known (NaN), nor is its
        attitude.
    axes : (3, 3) array
        An entry of `AXES`, or how a sensor is mounted.

    Raises
    ------
    FlightError
        A quaternion has no length.
    """
    given = np.asarray(quaternions, dtype=float).reshape(-1, 4)
    length = np.linalg.norm(given, axis=1)
    if (length <= 1e-6).any():
        raise FlightError(
            f"quaternion {int(np.flatnonzero(length <= 1e-6)[0]) + 1} has no length: "
            "expected x, y, z, w of length 1"
        )
    turns = _matrices(given) @ axes
    turns[np.isnan(length)] = np.nan
    pitch = np.arcsin(np.clip(turns[:, 2, 1], -1, 1))
    roll = np.arctan2(-turns[:, 2, 0], turns[:, 2, 2])
    yaw = np.arctan2(-turns[:, 0, 1], turns[:, 1, 1])
    return np.column_stack([roll, pitch, yaw])


def camera_attitude(quaternions: np.ndarray, axes: str) -> tuple[np.ndarray, str]:
    """The attitude of a camera whose axes are those of that name, and a sentence that tells which.

    A camera looks at the floor: with ``auto``, quaternions are a camera's where its axes say so in
    most rows, else a vehicle's.
    """
    if axes == "auto":
        up = (_matrices(np.asarray(quaternions, dtype=float)) @ AXES["camera"])[:, 2, 2]
        axes = "camera" if len(up) and np.median(up) > 0 else "flu"
    attitude = attitude_from_quaternions(quaternions, AXES[axes])
    return attitude, f"quaternions taken as those of axes {axes}"


def _matrices(quaternions: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    lengths = np.linalg.norm(quaternions, axis=1)
    matrices: np.ndarray = Rotation.from_quat(
        np.where(lengths[:, None] > 1e-6, quaternions, [0.0, 0, 0, 1])
    ).as_matrix()
    return matrices.reshape(-1, 3, 3)
