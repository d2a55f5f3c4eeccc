"""EuRoC / ASL folders: ``mav0/cam0`` with ``mocap0``, ``vicon0``, ``leica0`` or a ground truth
estimate.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trexton.errors import FlightError
from trexton.flights.frames import ImageFiles
from trexton.flights.importers.calibration import read_calibration
from trexton.flights.importers.recording import Recording, Track, attitude_from_quaternions
from trexton.flights.tables import column, read_table
from trexton.options import Options, option

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
    return Recording(
        _stamps(folder / "data.csv", table["stamp"]),
        _track(root / found / "data.csv"),
        ImageFiles(tuple(files)),
        camera=camera,
        distortion=distortion,
        source=f"ASL folder, {settings.camera} and {found}",
        said=[f"positions from {found}"],
    )


def _root(source: Path) -> Path:
    return source / "mav0" if (source / "mav0").is_dir() else source


def _stamps(path: Path, values: Any) -> np.ndarray:
    try:
        return np.array([int(value) for value in values], dtype=np.int64)
    except (ValueError, OverflowError):
        raise FlightError(f"{path}: a stamp is no whole number of nanoseconds") from None


def _track(path: Path) -> Track:
    table = read_table(path)
    names = list(table.columns[1:8])
    values = np.column_stack(
        [column(path, table, name).to_numpy() for name in names] or [np.empty((0, 0))]
    )
    if values.shape[1] < 3:
        raise FlightError(f"{path}: {values.shape[1] + 1} columns: expected stamp, x, y, z")
    attitude = None
    if values.shape[1] >= 7:  # w, x, y, z
        attitude = attitude_from_quaternions(values[:, [4, 5, 6, 3]])
    return Track(_stamps(path, table.iloc[:, 0]), values[:, :3], attitude)
