"""A CSV of frames: stamps, positions and image files, its columns and units named."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.options import option
from trexton.flights.frames import ImageFiles
from trexton.flights.importers.recording import Recording
from trexton.flights.importers.tracks import TrackColumns
from trexton.flights.tables import read_table

__all__ = ["Settings", "column_names", "read", "recognises"]


@dataclass(frozen=True)
class Settings(TrackColumns):
    """What can be chosen."""

    image: str = option("image", "column of the image files, beside the table")


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
    track, said = settings.of(table)
    files = tuple(source.parent / name for name in names[pictured])
    stamps = table.nanoseconds(settings.time, settings.time_unit)[pictured]
    return Recording(stamps, track, ImageFiles(files), source=f"table {source.name}", said=said)
