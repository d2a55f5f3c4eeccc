"""Photographs with GPS; metres are local, east and north. Positions are of EXIF, a table with
latitudes, a log of an autopilot, or a reconstruction (COLMAP, OpenSfM).
"""

import re
from collections import Counter
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from trexton.base.errors import FlightError, ParameterError
from trexton.base.options import Options, option
from trexton.flights.frames import ImageFiles
from trexton.flights.importers.autopilot import read_log
from trexton.flights.importers.axes import PHOTOGRAPHS, looks_away
from trexton.flights.importers.exif import Shot, missing_zones, number_of, read_shot
from trexton.flights.importers.recording import (
    NANO,
    PoseTrack,
    Recording,
    beside,
    heights_over,
    local_metres,
    on_globe,
    spread,
    together,
)
from trexton.flights.importers.tracks import metres, next_day, read_reconstruction
from trexton.flights.tables import read_table, time_of
from trexton.vision.images import natural_order, read_image

SUFFIXES = (".jpg", ".jpeg", ".tif", ".tiff", ".png")
OTHERS = (".heic", ".heif", ".avif", ".webp", ".dng", ".raw", ".cr2", ".cr3", ".nef", ".arw")
# What columns of a table may be called: by exiftool, Pix4D, Metashape and by hand.
_COLUMNS = {
    "lat": r"^[xy/ ]*(gps)?[ _]?lat(?!.*(ref|acc\w*|std|sigma|err\w*)$)",
    "lon": r"^[xy/ ]*(gps)?[ _]?(lon|lng)(?!.*(ref|acc\w*|std|sigma|err\w*)$)",
    "alt_m": r"^[z/ ]*(gps)?[ _]?alt(?!.*ref$)",
    "time": r"^time|date.?time",
    "file": r"file|^image|^label|^photo|^name",
}
_UNTIMED = "photographs without a time: taken as one a second, by their names"
_POSE = re.compile(r"(?i)(yaw|pitch|roll|heading|omega|kappa|relative)(?!.*(acc|std|err|ref))")
_BAND = re.compile(r"[_-](\d{1,2}|[A-Za-z]{2,6})$")  # ends the names of multispectral bands


@dataclass(frozen=True)
class Settings(Options):
    """What can be chosen."""

    positions: str = option(
        "", "table of file, lat, lon (alt_m, time), autopilot's log, or file of COLMAP or OpenSfM"
    )
    ground: float | None = option(None, "altitude of the ground in metres, for heights above it")


def recognises(source: Path) -> bool:
    return source.is_dir() and not (source / "mav0").is_dir() and bool(_files(source))


def _files(source: Path, suffixes: tuple[str, ...] = SUFFIXES) -> list[Path]:
    folder = source / "images" if (source / "images").is_dir() else source
    found = (each for each in folder.glob("[!.]*") if each.suffix.lower() in suffixes)
    files = sorted(filter(Path.is_file, found), key=natural_order)
    # Counters begin anew after 9999: what stands behind the gap in their numbers came first.
    parts = [part for file in files for part in re.findall(r"^(.*?)(\d{4})\D*$", file.stem)]
    counts = np.array([int(number) for _, number in parts])
    if len({begin for begin, _ in parts}) != 1 or len(parts) < len(files):
        return files
    gap = int(np.diff(counts, prepend=counts[0]).argmax())
    anew = counts[0] < 100 and counts[-1] > 9900 and counts[gap] - counts[gap - 1] > 5000
    return files[gap:] + files[:gap] if anew else files


def read(source: Path, settings: Settings) -> Recording:
    """The recording of a folder of photographs, in the order in which they were taken."""
    files = known = _files(source)
    said = [
        f"{count} files of {suffix} were left out: convert them to JPEG"
        for suffix, count in Counter(each.suffix.lower() for each in _files(source, OTHERS)).items()
    ]
    path = beside(source, settings.positions or "positions.csv")
    named = bool(settings.positions) or path.parent == source and path.is_file()
    shots = {file: read_shot(file) for file in files}
    if turned := sum(shot.turned not in (0, 1) for shot in shots.values()):
        fixed = "of a camera that is fixed to its vehicle set Orientation to 1"
        said.append(f"EXIF turns {turned} of {len(files)} photographs as they are read: {fixed}")
    if settings.positions and (log := read_log(path)) is not None:
        track, words = log
        words += missing_zones(shots, 0)
        if not any(shot.time_ns for shot in shots.values()):
            raise FlightError(f"{source}: no time in EXIF, by which {path.name} tells their places")
        stamps = _stamps(shots)
        if settings.ground is not None:
            raise ParameterError(f"{path.name} tells heights, not altitudes: leave --ground out")
        if not np.any(stamps % NANO):
            words.append("photographs tell whole seconds: their places may lie a second behind")
    elif settings.positions and (posed := read_reconstruction(path)) is not None:
        names, poses, words = posed
        rows = _by_name(path, names, files)
        known = list(rows)
        words += _left_out("photographs without a position", len(files) - len(known))
        stamps = _stamps({file: shots[file] for file in known})
        words += [_UNTIMED] * (not any(shots[file].time_ns for file in known))
        track = replace(poses.rows(np.array(list(rows.values()))), time_ns=stamps)
        if track.origin or settings.ground is not None:  # else heights are as it was aligned
            track.position[:, 2], more = heights_over(track.position[:, 2], settings.ground)
            words += more
    else:
        shots = _from_table(path, shots, said) if named else shots
        known, words = _located(source, path if named else None, files, shots)
        track, words_of_heights = _track([shots[file] for file in known], settings.ground)
        words += words_of_heights + missing_zones({file: shots[file] for file in known}, 1)
        stamps = track.time_ns
    if track.attitude is not None:
        words += filter(None, [looks_away(track.attitude, photographs=True)])
    name, frames = f"{PHOTOGRAPHS} {source.name}", ImageFiles(tuple(known))
    return Recording(stamps, track, frames, source=name, said=said + words)


def _left_out(what: str, count: int) -> list[str]:
    return [f"{what}, left out: {count}"] * (count > 0)


def _located(
    source: Path, table: Path | None, files: list[Path], shots: dict[Path, Shot]
) -> tuple[list[Path], list[str]]:
    """The photographs with a place, in the order in which they were taken, one of each shutter, and
    how many are without.
    """
    places = {file: (shot.latitude, shot.longitude) for file, shot in shots.items()}
    placed = [file for file in files if np.isfinite(places.get(file, np.nan)).all()]
    dated = [file for file in placed if table or shots[file].time_ns]
    said = _left_out("photographs without a position", len(files) - len(placed))
    if placed and not dated:
        said.append(_UNTIMED)
    elif undated := len(placed) - len(dated):
        said.append(f"photographs without a time that can be read, left out: {undated}")
        placed = dated
    fixed = [file for file in placed if np.abs(places[file]).max() > 1e-6]
    said += _left_out("photographs without a fix, at 0, 0", len(placed) - len(fixed))
    near = together([places[file] for file in fixed] or [(0, 0)])
    said += _left_out("photographs more than 100 km from the others", int((~near).sum()))
    fixed = [file for file, each in zip(fixed, near, strict=False) if each]
    if len(fixed) < 3:
        read_image(files[0])  # what cannot be read tells no place
        how = f"by name in {table}" if table else "by GPS in EXIF, or a table with --positions"
        found = f"{len(fixed)} of {len(files)} photographs have a position"
        raise FlightError(f"{source}: {found}: expected 3 or more, {how}")
    known, bands = _without_bands(fixed, shots)
    # Equal ones stay in order of names.
    return sorted(known, key=lambda file: shots[file].time_ns), said + bands


def _track(shots: list[Shot], ground: float | None) -> tuple[PoseTrack, list[str]]:
    """Metres above the floor are those from the altitude of the ground where it is given, else as
    the vehicle recorded them; an altitude above the sea is no height.
    """
    place, origin = local_metres(*np.array([(shot.latitude, shot.longitude) for shot in shots]).T)
    altitude = np.array([shot.altitude for shot in shots])
    height = np.array([shot.height for shot in shots])
    said = ["heights are those above the place of take-off, as XMP tells them"]
    if ground is not None or not np.isfinite(height).any():
        height, said = heights_over(altitude, ground)
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
    kept = {min(group, key=lambda own: own.suffix.lower() not in SUFFIXES[:2]) for group in groups}
    chosen = [file for file in files if file in kept]
    said = f"{usual} bands of one shutter at one place: kept {chosen[0].name} and its like"
    return chosen, [f"{said}, left out {len(files) - len(chosen)} files"]


def _by_name(path: Path, names: list[str], files: list[Path]) -> dict[Path, int]:
    """The row that names each file: by its whole name, else by the last part of it alone."""
    last = [PurePosixPath(name.replace("\\", "/")).name for name in names]
    whole = {name: row for row, name in enumerate(names)}
    twice = {name for name, count in Counter(last).items() if count > 1}
    short = {name: row for row, name in enumerate(last) if name not in twice}
    rows = {file: whole.get(file.name, short.get(file.name)) for file in files}
    found = {file: row for file, row in rows.items() if row is not None}
    if again := [name for name, count in Counter(names).items() if count > 1]:
        raise FlightError(f"{path} names {again[0]} {names.count(again[0])} times: leave one row")
    if names and not found:
        raise FlightError(f"{path} names {names[0]}, the folder holds {files[0].name}: correct it")
    return found


def _from_table(path: Path, shots: dict[Path, Shot], said: list[str]) -> dict[Path, Shot]:
    """The photographs that a table names, at its places; what to know of them is `said`."""
    table, names = read_table(path), dict[str, str]()
    for name in table.header:
        what = next((what for what, so in _COLUMNS.items() if re.search(so, name, re.I)), name)
        names.setdefault(what, name)
    read_too = {names.get(what) for what in _COLUMNS}
    if unread := [each for each in filter(_POSE.search, table.header) if each not in read_too]:
        said.append(f"{path}: {', '.join(unread)}: not read, heights and angles are those of XMP")
    found = _by_name(path, table.texts(names.get("file", "file")), list(shots))
    rows = dict(sorted(found.items(), key=lambda each: each[1]))
    said += _left_out(f"{path}: rows whose photograph is not there", len(table) - len(rows))
    row, known = list(rows.values()), [shots[file] for file in rows]
    cells = {key: [number_of(each[at]) for at in row] for key, each in table.cells.items()}
    table = replace(table, cells=cells, rows=[table.rows[at] for at in row])
    latitude, longitude = (table.numbers(names.get(what, what)) for what in ("lat", "lon"))
    for what, away, degrees in (("lat", "S", latitude), ("lon", "W", longitude)):
        for ref in filter(re.compile(f"(?i){what}.*ref$").search, table.header):
            away_from = [side[:1].upper() == away for side in table.texts(ref)]
            np.copyto(degrees, -np.abs(degrees), where=away_from)
    place = np.column_stack([latitude, longitude, metres(table, names.get("alt_m", ""), "m", said)])
    stamps = NANO * np.array(row)
    if timed := "time" in names:
        written = zip(table.rows, table.texts(names["time"]), strict=True)
        taken = [time_of(f"{path}, row {number}", text) for number, text in written]
        stamps = next_day(np.array(taken), path, table.rows, said)
    elif all(shot.time_ns for shot in known):
        stamps = np.array([shot.time_ns for shot in known])
    _check_places(path, place[:, :2], known, said)
    columns = zip(rows, known, place.tolist(), stamps.tolist(), strict=True)
    return {
        file: Shot(lat, lon, above, shot.height, shot.attitude, stamp, timed or shot.zoned)
        for file, shot, (lat, lon, above), stamp in columns
    }


def _check_places(path: Path, place: np.ndarray, shots: list[Shot], said: list[str]) -> None:
    own = np.array([(shot.latitude, shot.longitude) for shot in shots])
    known = np.isfinite(own + place).all(axis=1)
    if not known.any():
        return
    apart, exchanged = (
        np.median(np.linalg.norm(on_globe(each[known]) - on_globe(own[known]), axis=1))
        for each in (place, place[:, ::-1])
    )
    words = f"{path}: its places lie {apart:.4g} km from those in EXIF"
    if apart > 1 and exchanged < apart / 10:
        raise FlightError(f"{words}, exchanged {exchanged:.2g} km: exchange lat and lon")
    said += [f"{words}: are they of these photographs?"] if apart > 1 else []


def _stamps(shots: dict[Path, Shot]) -> np.ndarray:
    taken = [shot.time_ns for shot in shots.values()]
    if any(taken) and not all(taken):
        raise FlightError(f"{list(shots)[taken.index(0)]}: no time in its EXIF: leave it out")
    return _by_the_second(taken)


def _by_the_second(taken: list[int]) -> np.ndarray:
    """Photographs of one second are spread over it; a camera without a clock takes one a second."""
    stamps = np.array(taken, dtype=np.int64)
    return spread(stamps) if stamps.any() else np.arange(len(stamps), dtype=np.int64) * NANO
