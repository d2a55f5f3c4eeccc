"""TUM trajectories: ``stamp x y z qx qy qz qw`` in seconds and metres, beside a list of images."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.options import Options, option
from trexton.flights.frames import ImageFiles
from trexton.flights.importers.recording import (
    NANO,
    Recording,
    Track,
    axes_option,
    camera_attitude,
)
from trexton.flights.tables import read_text

__all__ = ["Settings", "nanoseconds", "read", "read_trajectory", "recognises"]


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
    rows = _rows(source / settings.images, 2)
    files = [source / name for _, name in rows]
    track, said = read_trajectory(source / settings.trajectory, settings.axes)
    return Recording(
        np.array([nanoseconds(source / settings.images, stamp) for stamp, _ in rows]),
        track,
        ImageFiles(tuple(files)),
        source="TUM folder",
        said=[said],
    )


def read_trajectory(path: Path, axes: str = "auto") -> tuple[Track, str]:
    """The track in a TUM file, and which `AXES` its quaternions were taken to turn.

    Raises
    ------
    FlightError
        The file cannot be read, or a row is not eight numbers.
    """
    rows = _rows(path, 8)
    try:
        values = np.array([row[1:] for row in rows], dtype=float)
    except ValueError as error:
        raise FlightError(f"{path}: {error}: expected stamp x y z qx qy qz qw") from None
    stamps = np.array([nanoseconds(path, row[0]) for row in rows], dtype=np.int64)
    attitude, said = camera_attitude(values[:, 3:], axes)
    return Track(stamps, values[:, :3], attitude), said


def nanoseconds(path: Path, text: str) -> int:
    """Seconds as text, to the nanosecond, which a float of today's Unix time would lose."""
    try:
        stamp = Decimal(text) * NANO
        if abs(stamp) < 2**63:
            return int(stamp)
    except (ArithmeticError, ValueError):
        pass
    raise FlightError(f"{path}: {text[:40]!r} is no stamp in seconds")


def _rows(path: Path, fields: int) -> list[list[str]]:
    lines = (line.split("#")[0].split() for line in read_text(path).splitlines())
    rows = [row for row in lines if row]
    if not rows or any(len(row) != fields for row in rows):
        number = next((i + 1 for i, row in enumerate(rows) if len(row) != fields), 0)
        found = f"entry {number} has {len(rows[number - 1])} fields" if number else "no entries"
        raise FlightError(f"{path}: {found}: expected {fields} separated by blanks")
    return rows
