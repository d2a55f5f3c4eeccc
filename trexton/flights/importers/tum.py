"""TUM trajectories: ``stamp x y z qx qy qz qw`` in seconds and metres, beside a list of images."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from trexton.base.options import Options, option
from trexton.flights.frames import ImageFiles
from trexton.flights.importers.axes import axes_option
from trexton.flights.importers.recording import PoseTrack, Recording, TrackColumns
from trexton.flights.tables import read_table

__all__ = ["Settings", "read", "read_trajectory", "recognises"]

_TRACK = TrackColumns("stamp", "x", "y", "z", quaternion=("qx", "qy", "qz", "qw"))


@dataclass(frozen=True)
class Settings(Options):
    """What can be chosen."""

    images: str = option("rgb.txt", "list of stamps and image files in the folder")
    trajectory: str = option("groundtruth.txt", "trajectory in the folder")
    axes: str = axes_option()


def recognises(source: Path) -> bool:
    defaults = Settings()
    return (source / defaults.images).is_file() and (source / defaults.trajectory).is_file()


def read(source: Path, settings: Settings) -> Recording:
    """The recording in a folder with an image list and a trajectory."""
    images = read_table(source / settings.images, ["stamp", "file"])
    track, said = read_trajectory(source / settings.trajectory, settings.axes)
    return Recording(
        images.nanoseconds("stamp"),
        track,
        ImageFiles(tuple(source / name for name in images.texts("file"))),
        source="TUM folder",
        said=said,
    )


def read_trajectory(path: Path, axes: str = "auto") -> tuple[PoseTrack, list[str]]:
    """The track in a TUM file, and which `AXES` its quaternions were taken to turn.

    Raises
    ------
    FlightError
        The file cannot be read, or a row is not eight numbers.
    """
    table = read_table(path, ["stamp", "x", "y", "z", "qx", "qy", "qz", "qw"])
    return _TRACK.read(table, axes)
