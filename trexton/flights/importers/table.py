"""A CSV of frames: stamps, positions and image files, its columns and units named."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.options import Options, option
from trexton.flights.frames import ImageFiles
from trexton.flights.importers.recording import NANO, Recording, Track
from trexton.flights.tables import column, read_table

__all__ = ["LENGTHS", "Settings", "nanoseconds", "read", "read_track", "recognises"]

LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
TIMES = {"s": NANO, "ms": 1_000_000, "us": 1000, "ns": 1}


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


def recognises(source: Path) -> bool:
    if not (source.is_file() and source.suffix.lower() in (".csv", ".tsv", ".txt")):
        return False
    try:
        names = set(read_table(source).columns)
    except FlightError:
        return False
    return {"x", "y", "image"} <= names


def read(source: Path, settings: Settings) -> Recording:
    """The recording that a table lists."""
    table = read_table(source)
    if settings.image not in table.columns:
        there = ", ".join(str(name) for name in table.columns)
        raise FlightError(f"{source}: no column {settings.image!r}: it has {there}: name it")
    names = table[settings.image].astype(object).fillna("").astype(str).str.strip()
    pictured = (names != "").to_numpy()  # the other rows are positions between the frames
    if not pictured.any():
        raise FlightError(
            f"{source}: no row of column {settings.image!r} names an image: name them"
        )
    files = tuple(source.parent / name for name in names[pictured])
    track = read_track(source, settings)
    stamps = track.time_ns[pictured]
    return Recording(stamps, track, ImageFiles(files), source=f"table {source.name}")


def read_track(source: Path, settings: Settings) -> Track:
    """Stamps, positions and headings of a table."""
    table = read_table(source)
    scale = LENGTHS[settings.unit]
    x, y = (scale * column(source, table, name).to_numpy() for name in (settings.x, settings.y))
    z = (
        scale * column(source, table, settings.z).to_numpy()
        if settings.z
        else np.full(len(x), np.nan)
    )
    attitude = None
    if settings.yaw:
        yaw = column(source, table, settings.yaw).to_numpy()
        yaw = np.radians(yaw) if settings.degrees else yaw
        attitude = np.column_stack([np.zeros_like(yaw), np.zeros_like(yaw), yaw])
    stamps = nanoseconds(column(source, table, settings.time).to_numpy(), settings.time_unit)
    return Track(stamps, np.column_stack([x, y, z]), attitude)


def nanoseconds(stamps: np.ndarray, unit: str) -> np.ndarray:
    """``(N,) int64``; raises `FlightError` for a stamp that is missing or beyond 292 years."""
    scaled = stamps * TIMES[unit]
    bad = ~(np.abs(scaled) < 2**63 - 1)
    if bad.any():
        row = int(bad.argmax())
        raise FlightError(f"row {row + 2}: stamp {stamps[row]} {unit}: expected a finite time")
    whole: np.ndarray = np.rint(scaled).astype(np.int64)
    return whole
