"""EuRoC / ASL folders: ``mav0/cam0`` with ``mocap0``, ``vicon0``, ``leica0`` or a ground truth
estimate.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.options import Options, option
from trexton.flights.frames import ImageFiles
from trexton.flights.importers.axes import AXES
from trexton.flights.importers.calibration import read_calibration, read_mounting
from trexton.flights.importers.recording import PoseTrack, Recording
from trexton.flights.importers.tracks import TrackColumns
from trexton.flights.tables import read_table

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
    files = [folder / "data" / name for name in table.texts("file")]
    names = [settings.track] if settings.track else list(TRACKS)
    found = next((name for name in names if (root / name / "data.csv").is_file()), None)
    if found is None:
        raise FlightError(f"{root}: no positions in {', '.join(names)}: name their folder")
    sensor = folder / "sensor.yaml"
    camera, distortion = read_calibration(sensor) if sensor.is_file() else (None, None)
    track, said = _track(root / found / "data.csv", sensor)
    return Recording(
        table.nanoseconds("stamp", "ns"),
        track,
        ImageFiles(tuple(files)),
        camera=camera,
        distortion=distortion,
        source=f"ASL folder, {settings.camera} and {found}",
        said=[f"positions from {found}", *said],
    )


def _root(source: Path) -> Path:
    return source / "mav0" if (source / "mav0").is_dir() else source


def _track(path: Path, camera: Path) -> tuple[PoseTrack, list[str]]:
    """Positions, and the attitude of the camera whose ``sensor.yaml`` tells how it is mounted."""
    table = read_table(path)
    names = table.header
    if len(names) < 4:
        raise FlightError(f"{path}: {len(names)} columns: expected stamp, x, y, z")
    turn = ",".join((*names[5:8], names[4]) if len(names) >= 8 else ())  # written w, x, y, z
    columns = TrackColumns(names[0], names[1], names[2], names[3], quaternion=turn, time_unit="ns")
    mounted = _mounting(camera)
    if mounted is None:
        return columns.of(table)
    # From the axes of what was tracked to the vehicle's, and from those to the camera's.
    tracked = _mounting(path.with_name("sensor.yaml"))
    axes = (np.eye(3) if tracked is None else tracked.T) @ mounted @ AXES["camera"]
    return columns.of(table, axes)


def _mounting(sensor: Path) -> np.ndarray | None:
    return read_mounting(sensor) if sensor.is_file() else None
