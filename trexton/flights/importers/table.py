"""A CSV of frames: stamps, positions and image files, its columns and units named."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.options import Options, option
from trexton.flights.frames import ImageFiles
from trexton.flights.importers.recording import Recording, TrackColumns
from trexton.flights.tables import LENGTHS, TIMES, read_table

__all__ = ["Settings", "column_names", "read", "recognises"]


@dataclass(frozen=True)
class Settings(Options):
    """What can be chosen."""

    time: str = option("t", "column of the stamps")
    x: str = option("x", "column of x")
    y: str = option("y", "column of y")
    z: str = option("", "column of the height above the floor")
    yaw: str = option("", "column of the yaw: anticlockwise, 0 where the picture's top is +y")
    image: str = option("image", "column of the image files, beside the table")
    time_unit: str = option("s", "unit of the stamps", choices=tuple(TIMES))
    unit: str = option("m", "unit of the positions", choices=tuple(LENGTHS))
    degrees: bool = option(False, "the yaw is in degrees")


def column_names(source: Path) -> set[str]:
    """Of a table; none where there is no table."""
    if not (source.is_file() and source.suffix.lower() in (".csv", ".tsv", ".txt")):
        return set()
    try:
        return set(read_table(source).header)
    except FlightError:
        return set()


def recognises(source: Path) -> bool:
    return {"x", "y", "image"} <= column_names(source)


def read(source: Path, settings: Settings) -> Recording:
    """The recording that a table lists."""
    table = read_table(source)
    names = np.array(table.texts(settings.image), dtype=object)
    pictured = names != ""  # the other rows are positions between the frames
    if not pictured.any():
        raise FlightError(
            f"{source}: no row of column {settings.image!r} names an image: name them"
        )
    columns = settings.as_dict()
    del columns["image"]
    track, _ = TrackColumns(**columns).read(table)
    files = tuple(source.parent / name for name in names[pictured])
    stamps = track.time_ns[pictured]
    return Recording(stamps, track, ImageFiles(files), source=f"table {source.name}")
