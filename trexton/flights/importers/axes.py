"""Attitudes from the quaternions of other systems, whose axes are named, given or guessed.

`AXES` has the usual ones; `camera_attitude` takes them by name, `attitude_from_quaternions` by
matrix. `looks_away` says where the camera then looks, `readings` which others look down.
"""

from collections.abc import Iterator

import numpy as np

from trexton.base.options import option

LOOKS_DOWN = 30.0  # degrees from straight down, in half of the frames, up to which nothing is said
MAX_ANGLE = 4 * np.pi  # radians: a yaw that is counted on through two turns
SURELY_DOWN = 15.0  # where another reading of a quaternion must lead to be named
TAKEN = "quaternions taken as those of axes "  # and a name: what an import says, and notes
PHOTOGRAPHS = "photographs of"  # begins a source whose attitudes are the gimbal's

# What a quaternion may turn, to the world, z up: right, forward and up of this project's vehicle
# (`trexton.vision.camera`), as columns in those axes. The likeliest first.
AXES = {
    "camera": np.diag([1.0, -1, -1]),
    "flu": np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]),  # REP 103
    "frd": np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]]),
    "rfu": np.eye(3),
}


def axes_option() -> str:
    """What an importer of quaternions declares; see `camera_attitude`."""
    return option(
        "auto",
        "axes that the quaternions turn: camera (right, down, ahead), flu (forward, left, up), "
        "frd, rfu; auto: camera where that looks down, else flu",
        choices=("auto", *AXES),
    )


def attitude_from_quaternions(quaternions: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """``(N, 3)`` roll, pitch, yaw as `trexton.vision.camera` defines them, from ``(N, 4)`` x, y, z,
    w, which take `axes` (an entry of `AXES`, or how a sensor is mounted) to the world's. Where a
    quaternion is not known (NaN or zero), nor is its attitude.
    """
    from scipy.spatial.transform import Rotation

    given = np.asarray(quaternions, dtype=float).reshape(-1, 4)
    known = np.linalg.norm(given, axis=1) > 1e-6
    turns = Rotation.from_quat(np.where(known[:, None], given, [0.0, 0, 0, 1]))
    angles = (turns * Rotation.from_matrix(axes)).as_euler("ZXY", suppress_warnings=True)
    angles[~known] = np.nan
    return angles[:, ::-1]


def quaternions_from_attitude(attitude: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """``(N, 4)`` x, y, z, w of which `attitude_from_quaternions` makes ``(N, 3)`` `attitude`; zero
    where that is not known.
    """
    from scipy.spatial.transform import Rotation

    known = np.isfinite(attitude).all(axis=1)
    turns = Rotation.from_euler("ZXY", attitude[known][:, [2, 1, 0]])
    quaternions = np.zeros((len(attitude), 4))
    quaternions[known] = (turns * Rotation.from_matrix(axes.T)).as_quat()
    return quaternions


def camera_attitude(quaternions: np.ndarray, axes: str) -> tuple[np.ndarray, list[str]]:
    """The attitude of a camera whose axes are those of that name, and sentences that tell which.

    A camera looks at the floor: with ``auto``, quaternions are a camera's where its axes say so in
    most rows, else a vehicle's.
    """
    if axes == "auto":
        down = _tilts(attitude_from_quaternions(quaternions, AXES["camera"]), 0.5) < 90
        axes = "camera" if down else "flu"
    attitude = attitude_from_quaternions(quaternions, AXES[axes])
    said = [TAKEN + axes]
    if doubt := looks_away(attitude):
        others = " or ".join(words for words, _ in readings(quaternions))
        said.append(doubt + (f" ({others} would look down)" if others else ""))
    return attitude, said


def readings(quaternions: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """What the same numbers may mean where the camera looks down, the likeliest first: words, and
    the attitude.
    """
    for order in (0, 1):
        for name, axes in AXES.items():
            attitude = attitude_from_quaternions(np.roll(quaternions, -order, axis=1), axes)
            if _tilts(attitude, 0.5) < SURELY_DOWN and _tilts(attitude, 0.9) < LOOKS_DOWN:
                yield f"axes {name}{', order w, x, y, z' if order else ''}", attitude


def looks_away(attitude: np.ndarray, photographs: bool = False) -> str:
    """A sentence where a camera of these roll, pitch, yaw does not look down in half of the frames,
    with the likely causes, which are others for `photographs`; empty where it does.
    """
    tilt = _tilts(attitude, 0.5)
    if not tilt > LOOKS_DOWN or np.nanmax(np.abs(attitude)) > MAX_ANGLE:  # those are degrees
        return ""
    causes = "another order (--quaternion), other axes (--axes), or a camera that looks ahead?"
    if photographs:
        causes = "a gimbal that was not at -90 degrees, or a reconstruction that was not aligned?"
    elif tilt > 150:
        causes = "axes whose z points down (--axes frd or camera)?"
    return f"the camera looks {tilt:.0f} degrees from straight down in half of the frames: {causes}"


def _tilts(attitude: np.ndarray, share: float) -> float:
    """Degrees from straight down within which the camera's axis is in this share of the rows; NaN
    where no attitude is known.
    """
    tilts = np.degrees(np.arccos(np.cos(attitude[:, 0]) * np.cos(attitude[:, 1])))
    known = tilts[np.isfinite(tilts)]
    return float(np.quantile(known, share)) if len(known) else np.nan
