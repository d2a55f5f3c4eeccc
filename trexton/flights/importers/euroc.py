"""EuRoC / ASL folders: ``mav0/cam0`` with ``mocap0``, ``vicon0``, ``leica0`` or a ground truth
estimate.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.options import Options, option
from trexton.flights.frames import ImageFiles
from trexton.flights.importers.calibration import read_calibration, read_mounting
from trexton.flights.importers.recording import (
    AXES,
    Recording,
    Track,
    attitude_from_quaternions,
    camera_attitude,
)
from trexton.flights.tables import column, read_table

__all__ = ["Settings", "read", "recognises"]

TRACKS = ("mocap0", "vicon0", "leica0", "state_groundtruth_estimate0")


@dataclass(frozen=True)
class Settings(Options):
    """What can be chosen."""

    camera: str = option("cam0", "folder of the camera")
    track: str = option("", "folder of the positions (default: the first of its usual names)")


def recognises(source: Path) -> bool:
    return (_root(source) / "cam0" / "data.csv").is_file()


def read(source: Path, settings: Settings) -> Recording:
    """The recording in an ASL folder: the folder itself, or the one that holds ``mav0``."""
    root = _root(source)
    folder = root / settings.camera
    table = read_table(folder / "data.csv", ["stamp", "file"])
    files = [folder / "data" / str(name).strip() for name in table["file"]]
    names = [settings.track] if settings.track else list(TRACKS)
    found = next((name for name in names if (root / name / "data.csv").is_file()), None)
    if found is None:
        raise FlightError(f"{root}: no positions in {', '.join(names)}: name their folder")
    sensor = folder / "sensor.yaml"
    camera, distortion = read_calibration(sensor) if sensor.is_file() else (None, None)
    track, said = _track(root / found / "data.csv", sensor)
    return Recording(
        _stamps(folder / "data.csv", table["stamp"]),
        track,
        ImageFiles(tuple(files)),
        camera=camera,
        distortion=distortion,
        source=f"ASL folder, {settings.camera} and {found}",
        said=[f"positions from {found}", *said],
    )


def _root(source: Path) -> Path:
    return source / "mav0" if (source / "mav0").is_dir() else source


def _stamps(path: Path, values: Any) -> np.ndarray:
    try:
        return np.array([int(value) for value in values], dtype=np.int64)
    except (ValueError, OverflowError):
        raise FlightError(f"{path}: a stamp is no whole number of nanoseconds") from None


def _track(path: Path, camera: Path) -> tuple[Track, list[str]]:
    """Positions, and the attitude of the camera whose ``sensor.yaml`` tells how it is mounted."""
    table = read_table(path)
    names = list(table.columns[1:8])
    values = np.column_stack(
        [column(path, table, name).to_numpy() for name in names] or [np.empty((0, 0))]
    )
    if values.shape[1] < 3:
        raise FlightError(f"{path}: {values.shape[1] + 1} columns: expected stamp, x, y, z")
    stamps = _stamps(path, table.iloc[:, 0])
    if values.shape[1] < 7:
        return Track(stamps, values[:, :3]), []
    quaternions = values[:, [4, 5, 6, 3]]  # they are written w, x, y, z
    mounted = _mounting(camera)
    if mounted is None:
        attitude, said = camera_attitude(quaternions, "auto")
    else:
        # From the axes of what was tracked to the vehicle's, and from those to the camera's.
        tracked = _mounting(path.with_name("sensor.yaml"))
        axes = (np.eye(3) if tracked is None else tracked.T) @ mounted @ AXES["camera"]
        attitude = attitude_from_quaternions(quaternions, axes)
        said = "attitude of the camera as T_BS tells"
    return Track(stamps, values[:, :3], attitude), [said]


def _mounting(sensor: Path) -> np.ndarray | None:
    return read_mounting(sensor) if sensor.is_file() else None
