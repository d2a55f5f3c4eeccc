"""Photographs with GPS: positions from EXIF, or from a table with latitudes; local metres east and
north.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.options import Options, option
from trexton.flights.frames import ImageFiles
from trexton.flights.geodesy import local_metres
from trexton.flights.importers.recording import NANO, PoseTrack, Recording, beside
from trexton.flights.tables import read_table

__all__ = ["Settings", "read", "recognises"]

SUFFIXES = (".jpg", ".jpeg", ".tif", ".tiff", ".png")
_GPS, _DETAILS = 0x8825, 0x8769  # EXIF directories
_TAKEN = (0x9003, 0x0132)  # when it was taken, when the file was changed


@dataclass(frozen=True)
class Settings(Options):
    """What can be chosen."""

    positions: str = option("", "table of file, latitude, longitude instead of EXIF")
    file: str = option("file", "its column of file names")
    latitude: str = option("lat", "its column of latitudes in degrees")
    longitude: str = option("lon", "its column of longitudes in degrees")
    altitude: str = option("alt_m", "its column of altitudes in metres, where there is one")
    taken: str = option("time", "its column of times, where there is one")
    ground: float = option(0.0, "altitude of the ground in metres")


def recognises(source: Path) -> bool:
    return source.is_dir() and not (source / "mav0").is_dir() and bool(_files(_folder(source)))


def _folder(source: Path) -> Path:
    return source / "images" if (source / "images").is_dir() else source


def _files(folder: Path) -> list[Path]:
    return sorted(
        path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES and path.is_file()
    )


def read(source: Path, settings: Settings) -> Recording:
    """The recording of a folder of photographs, in the order in which they were taken."""
    files = _files(_folder(source))
    default = source / "positions.csv"
    if settings.positions:
        places = _from_table(beside(source, settings.positions), files, settings)
    elif default.is_file():
        places = _from_table(default, files, settings)
    else:
        places = {file: _from_exif(file) for file in files}
        undated = [file for file, place in places.items() if place and not place[3]]
        if undated and len(undated) < sum(place is not None for place in places.values()):
            raise FlightError(
                f"{undated[0]}: no time in its EXIF, where other photographs have one: leave it "
                "out, or name a table with --positions"
            )
    known = [file for file in files if (at := places.get(file)) and np.isfinite(at[:2]).all()]
    if len(known) < 3:
        raise FlightError(
            f"{source}: {len(known)} of {len(files)} photographs have a position: expected 3 "
            "or more, by GPS in their EXIF or by a table named with --positions"
        )
    taken: dict[Path, Any] = {file: places[file] for file in known}
    order = sorted(known, key=lambda file: (taken[file][3], file.name))
    values = np.array([taken[file][:3] for file in order], dtype=float)
    stamps = _increasing(np.array([taken[file][3] for file in order], dtype=np.int64))
    place, origin = local_metres(values[:, 0], values[:, 1])
    position = np.column_stack([place, values[:, 2] - settings.ground])
    missing = len(files) - len(known)
    return Recording(
        stamps,
        PoseTrack(stamps, position),
        ImageFiles(tuple(order)),
        source=f"photographs of {source.name}",
        origin=origin,
        said=[f"photographs without a position, left out: {missing}"] if missing else [],
    )


def _from_table(
    path: Path, files: list[Path], settings: Settings
) -> dict[Path, tuple[float, float, float, int] | None]:
    table = read_table(path)
    names = table.texts(settings.file)
    latitude, longitude = table.numbers(settings.latitude), table.numbers(settings.longitude)
    altitude = (
        table.numbers(settings.altitude)
        if settings.altitude in table.header
        else np.full(len(table), np.nan)
    )
    times = (
        [_stamp(path, text) for text in table.texts(settings.taken)]
        if settings.taken in table.header
        else [row * NANO for row in range(len(table))]
    )
    rows = dict(zip(names, zip(latitude, longitude, altitude, times, strict=True), strict=True))
    return {file: rows.get(file.name) for file in files}


def _from_exif(path: Path) -> tuple[float, float, float, int] | None:
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as image:
            exif = image.getexif()
            gps, details = exif.get_ifd(_GPS), exif.get_ifd(_DETAILS)
        latitude, longitude = _degrees(gps[2], gps[1], "S"), _degrees(gps[4], gps[3], "W")
    except (
        KeyError, TypeError, ValueError, ZeroDivisionError, UnidentifiedImageError, OSError,
        Image.DecompressionBombError,
    ):  # fmt: skip
        return None
    altitude = float(gps[6]) * (-1 if gps.get(5) in (1, b"\x01") else 1) if 6 in gps else np.nan
    text = next(
        (str(table[tag]) for tag in _TAKEN for table in (details, exif) if tag in table), ""
    )
    return latitude, longitude, altitude, _stamp(path, text) if text else 0


def _degrees(parts: Any, side: str, negative: str) -> float:
    degrees, minutes, seconds = (float(part) for part in parts)
    value = degrees + minutes / 60 + seconds / 3600
    return -value if str(side).upper().startswith(negative) else value


def _stamp(path: Path, text: str) -> int:
    """Nanoseconds since 1970 of an EXIF time such as ``2013:06:04 13:37:29``, or one of ISO 8601,
    taken as UTC where it tells no zone; zero where a camera without a clock wrote it.
    """
    if not text.strip(" 0:"):
        return 0
    try:
        date, clock = text.strip()[:10], text.strip()[10:]
        moment = datetime.fromisoformat(date.replace(":", "-") + clock)
        moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
        stamp = round(moment.timestamp() * 1e6) * 1000
        if abs(stamp) < 2**63:  # until the year 2262
            return stamp
    except ValueError:
        pass
    raise FlightError(f"{path}: {text[:40]!r} is no time: expected one such as 2013:06:04 13:37:29")


def _increasing(stamps: np.ndarray) -> np.ndarray:
    """Stamps of whole seconds are shared by photographs in a burst: each comes a millisecond
    later.
    """
    result = stamps.copy()
    for row in range(1, len(result)):
        result[row] = max(result[row], result[row - 1] + NANO // 1000)
    return result
