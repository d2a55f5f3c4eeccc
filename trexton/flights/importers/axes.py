"""Attitudes from the quaternions of other systems, whose axes are named, given or guessed.

`AXES` has the usual ones; `camera_attitude` takes them by name, `attitude_from_quaternions` by
matrix; `looks_away` says where the camera then looks and what may be wrong.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from trexton.base.options import option

__all__ = ["AXES", "attitude_from_quaternions", "axes_option", "camera_attitude", "looks_away"]

LOOKS_DOWN = 30.0  # degrees from straight down, in half of the frames, up to which nothing is said
SURELY_DOWN = 15.0  # where another reading of a quaternion must lead to be named

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
        They take the source's axes to the world's. Where one is not known (NaN or zero), nor is
        its attitude.
    axes : (3, 3) array
        An entry of `AXES`, or how a sensor is mounted.
    """
    given = np.asarray(quaternions, dtype=float).reshape(-1, 4)
    length = np.linalg.norm(given, axis=1)
    turns = _matrices(given) @ axes
    turns[~(length > 1e-6)] = np.nan
    pitch = np.arcsin(np.clip(turns[:, 2, 1], -1, 1))
    roll = np.arctan2(-turns[:, 2, 0], turns[:, 2, 2])
    yaw = np.arctan2(-turns[:, 0, 1], turns[:, 1, 1])
    return np.column_stack([roll, pitch, yaw])


def camera_attitude(quaternions: np.ndarray, axes: str) -> tuple[np.ndarray, list[str]]:
    """The attitude of a camera whose axes are those of that name, and sentences that tell which.

    A camera looks at the floor: with ``auto``, quaternions are a camera's where its axes say so in
    most rows, else a vehicle's.
    """
    quaternions = np.asarray(quaternions, dtype=float)
    if axes == "auto":
        up = np.cos(_median_tilt(attitude_from_quaternions(quaternions, AXES["camera"])))
        axes = "camera" if up > 0 else "flu"
    attitude = attitude_from_quaternions(quaternions, AXES[axes])
    said = [f"quaternions taken as those of axes {axes}"]
    others = [
        f"axes {name}{', order w, x, y, z' if rolled else ''}"
        for rolled in (0, 1)
        for name, turned in AXES.items()
        if np.degrees(_median_tilt(_read_as(quaternions, rolled, turned))) < SURELY_DOWN
    ]
    if doubt := looks_away(attitude):
        hint = f" ({' or '.join(others)} would look down)" if others else ""
        said.append(f"{doubt}{hint}")
    return attitude, said


def _read_as(quaternions: np.ndarray, rolled: int, axes: np.ndarray) -> np.ndarray:
    return attitude_from_quaternions(np.roll(quaternions, -rolled, axis=1), axes)


def looks_away(attitude: np.ndarray) -> str:
    """A sentence where a camera of these roll, pitch, yaw does not look down in half of the frames,
    with the likely causes; empty where it does.
    """
    tilt = np.degrees(_median_tilt(attitude))
    if not tilt > LOOKS_DOWN:
        return ""
    causes = (
        "another order of the quaternion (--quaternion), other axes (--axes), or a camera that "
        "looks ahead?"
    )
    if tilt > 150:
        causes = "axes whose z points down (--axes frd or camera)?"
    return (
        f"the camera looks {tilt:.0f} degrees from straight down in half of the frames: {causes} "
        "the map is of the floor, below the camera"
    )


def _median_tilt(attitude: np.ndarray) -> float:
    """Radians between the camera's axis and straight down; NaN where no attitude is known."""
    tilts = np.arccos(np.cos(attitude[:, 0]) * np.cos(attitude[:, 1]))
    known = tilts[np.isfinite(tilts)]
    return float(np.median(known)) if len(known) else np.nan


def _matrices(quaternions: np.ndarray) -> np.ndarray:
    from scipy.spatial.transform import Rotation

    lengths = np.linalg.norm(quaternions, axis=1, keepdims=True)
    matrices: np.ndarray = Rotation.from_quat(
        np.where(lengths > 1e-6, quaternions, [0.0, 0, 0, 1])
    ).as_matrix()
    return matrices.reshape(-1, 3, 3)
