"""Photographs with GPS; metres are local, east and north. Positions are of EXIF, a table with
latitudes, a log of an autopilot, or a reconstruction (COLMAP, OpenSfM).
"""

import json
import re
from collections import Counter
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.files import read_text
from trexton.base.options import Options, option
from trexton.flights.frames import ImageFiles
from trexton.flights.importers.autopilot import read_log
from trexton.flights.importers.axes import camera_attitude
from trexton.flights.importers.exif import Shot, missing_zones, read_shot
from trexton.flights.importers.recording import (
    NANO,
    PoseTrack,
    Recording,
    beside,
    local_metres,
    spread,
)
from trexton.flights.tables import is_number, read_table, time_of
from trexton.vision.images import natural_order, read_image

SUFFIXES = (".jpg", ".jpeg", ".tif", ".tiff", ".png")
OTHERS = (".heic", ".heif", ".avif", ".webp", ".dng", ".raw", ".cr2", ".cr3", ".nef", ".arw")
_NEAR = 100 / 6371  # radii of the Earth
# What columns of a table may be called: by exiftool, Pix4D, Metashape and by hand.
_COLUMNS = {
    "lat": r"^[xy/ ]*(gps)?[ _]?lat(?!.*ref$)",
    "lon": r"^[xy/ ]*(gps)?[ _]?(lon|lng)(?!.*ref$)",
    "alt_m": r"^[z/ ]*(gps)?[ _]?alt(?!.*ref$)",
    "time": r"^time|date.?time",
    "file": r"file|^image|^label|^photo|^name",
}
_BAND = re.compile(r"[_-](\d{1,2}|[A-Za-z]{2,6})$")  # ends the names of multispectral bands


@dataclass(frozen=True)
class Settings(Options):
    """What can be chosen."""

    positions: str = option(
        "",
        "table of file, lat, lon (alt_m, time) instead of EXIF; or a log of an autopilot, "
        "COLMAP's images.txt, OpenSfM's reconstruction.json",
    )
    ground: float | None = option(
        None, "altitude of the ground in metres, which makes heights of altitudes"
    )


def recognises(source: Path) -> bool:
    return source.is_dir() and not (source / "mav0").is_dir() and bool(_files(source))


def _files(source: Path, suffixes: tuple[str, ...] = SUFFIXES) -> list[Path]:
    folder = source / "images" if (source / "images").is_dir() else source
    found = (each for each in folder.glob("[!.]*") if each.suffix.lower() in suffixes)
    return sorted(filter(Path.is_file, found), key=natural_order)


def read(source: Path, settings: Settings) -> Recording:
    """The recording of a folder of photographs, in the order in which they were taken."""
    files = known = _files(source)
    said = [
        f"{count} files of {suffix} were left out: convert them to JPEG"
        for suffix, count in Counter(each.suffix.lower() for each in _files(source, OTHERS)).items()
    ]
    path = beside(source, settings.positions or "positions.csv")
    named = bool(settings.positions) or path.parent == source and path.is_file()
    if settings.positions and (log := read_log(path)) is not None:
        track, words = log.ordered(str(path))
        shots = {file: read_shot(file) for file in files}
        words += missing_zones(shots, 0)
        stamps = _stamps(shots)
    elif settings.positions and (posed := _read_reconstruction(path)) is not None:
        names, poses, words = posed
        rows = _by_name(path, names, files)
        known = list(rows)
        words += _left_out(len(files) - len(known))
        stamps = _stamps({file: read_shot(file) for file in known})
        track = replace(poses.rows(np.array(list(rows.values()))), time_ns=stamps)
    else:
        shots = _from_table(path, files) if named else {file: read_shot(file) for file in files}
        known, words = _located(source, path if named else None, files, shots)
        track, words_of_heights = _track([shots[file] for file in known], settings.ground)
        words += words_of_heights + missing_zones({file: shots[file] for file in known}, 1)
        stamps = track.time_ns
    name, frames = f"photographs of {source.name}", ImageFiles(tuple(known))
    return Recording(stamps, track, frames, source=name, said=said + words)


def _left_out(count: int) -> list[str]:
    return [f"photographs without a position, left out: {count}"] * bool(count)


def _located(
    source: Path, table: Path | None, files: list[Path], shots: dict[Path, Shot]
) -> tuple[list[Path], list[str]]:
    """The photographs with a place, in the order in which they were taken, one of each shutter, and
    how many are without.
    """
    places = {file: (shot.latitude, shot.longitude) for file, shot in shots.items()}
    placed = [file for file in files if np.isfinite(places.get(file, np.nan)).all()]
    dated = [file for file in placed if table or shots[file].time_ns]
    said = _left_out(len(files) - len(placed))
    if placed and not dated:
        said.append("photographs without a time: taken as one a second, by their names")
    elif undated := len(placed) - len(dated):
        said.append(f"photographs without a time that can be read, left out: {undated}")
        placed = dated
    fixed = [file for file in placed if np.abs(places[file]).max() > 1e-6]
    if unfixed := len(placed) - len(fixed):
        said.append(f"photographs without a fix, at 0, 0, left out: {unfixed}")
    if fixed and not (near := _near([shots[file] for file in fixed])).all():
        said.append(f"photographs more than 100 km from the others, left out: {(~near).sum()}")
        fixed = [file for file, each in zip(fixed, near, strict=True) if each]
    if len(fixed) < 3:
        read_image(files[0])  # what cannot be read tells no place
        by_gps = "by GPS in their EXIF or by a table named with --positions"
        how = by_gps if table is None else f"by name in {table}"
        raise FlightError(
            f"{source}: {len(fixed)} of {len(files)} photographs have a position: expected 3 "
            f"or more, {how}"
        )
    known, bands = _without_bands(fixed, shots)
    # Equal ones stay in order of names.
    return sorted(known, key=lambda file: shots[file].time_ns), said + bands


def _near(shots: list[Shot]) -> np.ndarray:
    """Which places are within some 100 km of where most are: one projection serves no others."""
    latitude, longitude = np.radians([(shot.latitude, shot.longitude) for shot in shots]).T
    across = np.cos(latitude) * np.exp(1j * longitude)
    globe = np.column_stack([across.real, across.imag, np.sin(latitude)])
    return np.linalg.norm(globe - np.median(globe, axis=0), axis=1) < _NEAR


def _track(shots: list[Shot], ground: float | None) -> tuple[PoseTrack, list[str]]:
    """Metres above the floor are those from the altitude of the ground where it is given, else as
    the vehicle recorded them; an altitude above the sea is no height.
    """
    place, origin = local_metres(*np.array([(shot.latitude, shot.longitude) for shot in shots]).T)
    altitude = np.array([shot.altitude for shot in shots])
    height, said = np.array([shot.height for shot in shots]), []
    if ground is not None:
        height = altitude - ground
    elif np.isfinite(height).any():
        said = ["heights are those above the place of take-off, as XMP tells them"]
    elif np.isfinite(altitude).any():
        said = [
            f"altitudes (about {np.nanmedian(altitude):.0f} m) are above the sea, not above the "
            "floor: heights left out; give --ground METRES, the altitude of the floor"
        ]
    attitude = np.array([shot.attitude for shot in shots], dtype=float)
    stamps = _by_the_second([shot.time_ns for shot in shots])
    known = attitude if np.isfinite(attitude).any() else None
    return PoseTrack(stamps, np.column_stack([place, height]), known, origin), said


def _without_bands(files: list[Path], shots: dict[Path, Shot]) -> tuple[list[Path], list[str]]:
    """One picture of each shutter of a multispectral camera: the one in colour, else the first."""

    def shutter(file: Path) -> tuple[Any, ...]:
        shot = shots[file]
        return shot.time_ns, shot.latitude, shot.longitude, "" if shot.time_ns else file.name

    groups = [list(each) for _, each in groupby(sorted(files, key=shutter), key=shutter)]
    usual, often = Counter(map(len, groups)).most_common(1)[0]
    mixed = len({file.suffix.lower() for file in files}) > 1
    stems = all(len({_BAND.sub("", file.stem) for file in group}) == 1 for group in groups)
    if usual < 3 or often < 0.8 * len(groups) or not (mixed or stems):
        return files, []
    coloured = SUFFIXES[:2]
    kept = {min(group, key=lambda file: file.suffix.lower() not in coloured) for group in groups}
    chosen = [file for file in files if file in kept]
    return chosen, [
        f"{usual} bands of one shutter at one place: kept {chosen[0].name} and its like, left out "
        f"{len(files) - len(chosen)} files"
    ]


def _by_name(path: Path, names: list[str], files: list[Path]) -> dict[Path, int]:
    """The row that names each file: by its whole name, else by the last part of it alone."""
    last = [PurePosixPath(name.replace("\\", "/")).name for name in names]
    whole = {name: row for row, name in enumerate(names)}
    twice = {name for name, count in Counter(last).items() if count > 1}
    short = {name: row for row, name in enumerate(last) if name not in twice}
    rows = {file: whole.get(file.name, short.get(file.name)) for file in files}
    found = {file: row for file, row in rows.items() if row is not None}
    if names and not found:
        raise FlightError(f"{path} names {names[0]}, the folder holds {files[0].name}: correct it")
    return found


def _from_table(path: Path, files: list[Path]) -> dict[Path, Shot]:
    table, known = read_table(path), dict[str, list[str]]()
    for name, cells in table.cells.items():
        what = next((what for what, so in _COLUMNS.items() if re.search(so, name, re.I)), name)
        known.setdefault(what, [_of_exiftool(cell) for cell in cells])
    table = replace(table, cells=known)
    latitude, longitude = table.numbers("lat"), table.numbers("lon")
    altitude = table.numbers("alt_m") if "alt_m" in table.header else np.nan + latitude
    taken = table.texts("time") if "time" in table.header else None
    rows = _by_name(path, table.texts("file"), files)
    shots = {file: read_shot(file) for file in rows}
    timed = all(shot.time_ns for shot in shots.values())
    for file, row in rows.items():
        place = {"latitude": latitude[row], "longitude": longitude[row], "altitude": altitude[row]}
        stamp = time_of(path, taken[row]) if taken else shots[file].time_ns if timed else row * NANO
        zoned = taken is not None or shots[file].zoned
        shots[file] = replace(shots[file], **place, time_ns=stamp, zoned=zoned)
    return shots


def _of_exiftool(text: str) -> str:
    """A number of ``52 deg 5' 34.44" N`` or ``12 m Below Sea Level``; other texts as they are."""
    found = re.fullmatch(r"""([\d.]+) (deg|m)\b(?: ([\d.]+)' ([\d.]+)\")?(.*)""", text.strip())
    if found is None:
        return text
    degrees, _, minutes, seconds, side = found.groups()
    sign = -1 if side.strip()[:1] in ("S", "W", "B") else 1
    return str(sign * (float(degrees) + float(minutes or 0) / 60 + float(seconds or 0) / 3600))


def _stamps(shots: dict[Path, Shot]) -> np.ndarray:
    taken = [shot.time_ns for shot in shots.values()]
    if any(taken) and not all(taken):
        raise FlightError(f"{list(shots)[taken.index(0)]}: no time in its EXIF: leave it out")
    return _by_the_second(taken)


def _by_the_second(taken: list[int]) -> np.ndarray:
    """Photographs of one second are spread over it; a camera without a clock takes one a second."""
    stamps = np.array(taken, dtype=np.int64)
    return spread(stamps) if stamps.any() else np.arange(len(stamps), dtype=np.int64) * NANO


def _read_reconstruction(path: Path) -> tuple[list[str], PoseTrack, list[str]] | None:
    """The names of the photographs, their poses (all at time 0), and what to know; None for others.
    Raises `FlightError` where the file is one, but cannot be read.
    """
    from scipy.spatial.transform import Rotation

    if path.suffix.lower() not in (".json", ".txt"):
        return None
    text, origin, several = read_text(path), None, ""
    try:
        if path.suffix.lower() == ".json":
            parts = json.loads(text)
            whole = max(parts, key=lambda part: len(part["shots"]))
            several = f", the largest of {len(parts)} in it" * (len(parts) > 1)
            names, shots = list(whole["shots"]), whole["shots"].values()
            turns = Rotation.from_rotvec([shot["rotation"] for shot in shots]).as_quat()
            shifts = [shot["translation"] for shot in shots]
            place = whole.get("reference_lla")
            origin = (float(place["latitude"]), float(place["longitude"])) if place else None
        elif "IMAGE_ID" in text[:2000] or "QW" in text[:2000]:
            # Two lines an image: id, quaternion w, x, y, z, translation, camera, name; then points.
            lines = [line.split(maxsplit=9) for line in text.splitlines() if line[:1] != "#"]
            rows = [row for row in lines if row and not is_number(row[-1].split()[-1])]
            turns = [[float(row[place]) for place in (2, 3, 4, 1)] for row in rows]
            names, shifts = [row[9].strip() for row in rows], [row[5:8] for row in rows]
        else:
            return None
        # Both tell how the world is turned and moved to the camera (right, down, ahead).
        to_world = Rotation.from_quat(np.array(turns, dtype=float)).inv()
        centres = -to_world.apply(np.array(shifts, dtype=float))
    except (AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
        raise FlightError(f"{path}: not a reconstruction that can be read ({error})") from None
    attitude, said = camera_attitude(to_world.as_quat(), "camera")
    scale = "" if origin else "; its unit and axes are its own, unless it was aligned"
    said = [f"{path}: {len(names)} poses of a reconstruction{several}{scale}", *said[1:]]
    zero = np.zeros(len(names), dtype=np.int64)
    return names, PoseTrack(zero, centres, attitude, origin), said
