"""The Flight folder: ``flight.toml``, ``frames.csv``, and optionally ``images/`` and ``histograms.csv``.

Reading collects every fault with its file and row; `read_flight` raises on the first, `trexton check` prints them all.
"""

from __future__ import annotations

import csv
import os
import shutil
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from trexton.camera import Camera
from trexton.errors import FlightError
from trexton.files import atomic_folder
from trexton.flights.flight import Flight

__all__ = ["read_flight", "write_flight", "load_folder", "Reading"]

FORMAT = 1
_REQUIRED = ("frame", "t_s", "x_m", "y_m")
_OPTIONAL = ("z_m", "roll_rad", "pitch_rad", "yaw_rad", "image")
_TOP = {"format", "name", "source", "licence", "area_m", "notes", "camera", "split", "floor"}
SUM_TOLERANCE = 0.01


@dataclass
class Reading:
    """What a folder gave: a flight if it is usable, and its faults as sentences (file, row, what is wrong)."""

    flight: Flight | None = None
    faults: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)


def read_flight(path: str | os.PathLike) -> Flight:
    """Read a Flight folder; missing positions are allowed (NaN), everything else must be sound.

    Raises
    ------
    FlightError
        Naming the file, the row and the first fault.
    """
    reading = load_folder(Path(path))
    if reading.faults:
        more = f" (and {len(reading.faults) - 1} more: trexton check {path})" if len(reading.faults) > 1 else ""
        raise FlightError(reading.faults[0] + more)
    return reading.flight


def load_folder(path: Path) -> Reading:
    """Read a Flight folder and collect its faults instead of raising."""
    reading = Reading()
    if not path.is_dir():
        reading.faults.append(f"{path}: no such folder: give the folder that holds flight.toml")
        return reading
    header = _read_header(path / "flight.toml", reading)
    columns = _read_frames(path / "frames.csv", reading)
    histograms = None
    if columns is not None and (path / "histograms.csv").exists():
        histograms = _read_histograms(path / "histograms.csv", columns["frame"], reading)
    if reading.faults or header is None or columns is None:
        return reading
    names = columns.get("image")
    files = None if names is None else tuple(path / "images" / name for name in names)
    for row, file in enumerate(files or ()):
        if not file.is_file():
            reading.faults.append(f"{path / 'frames.csv'}, row {row + 2}: image {file.name!r} is not in {path / 'images'}: add the file or drop the row")
    if files is None and histograms is None:
        reading.faults.append(f"{path}: neither images nor histograms.csv found: a flight needs at least one of them")
    if not reading.faults:
        reading.flight = _assemble(path, header, columns, files, histograms)
    return reading


def _assemble(path: Path, header: dict, columns: dict, files, histograms) -> Flight:
    position = np.column_stack([columns["x_m"], columns["y_m"]])
    angles = [columns.get(name) for name in ("roll_rad", "pitch_rad", "yaw_rad")]
    floor = header.get("floor")
    return Flight(
        name=header.get("name", path.name),
        frame=columns["frame"],
        time=columns["t_s"],
        position=position,
        area=tuple(header["area_m"]) if "area_m" in header else _extent(position),
        height=columns.get("z_m"),
        attitude=None if any(angle is None for angle in angles) else np.column_stack(angles),
        image_files=files,
        histograms=histograms,
        camera=_camera(header["camera"]) if "camera" in header else None,
        split={key: (int(first), int(last)) for key, (first, last) in header.get("split", {}).items()},
        floor_file=path / floor["image"] if floor else None,
        floor_from_pixel=np.array(floor["world_from_pixel"], dtype=float) if floor else None,
        source=header.get("source", ""),
        licence=header.get("licence", ""),
        notes=tuple(header.get("notes", ())),
    )


def _camera(table: dict) -> Camera:
    center = table.get("center_px")
    return Camera(table["width_px"], table["height_px"], float(table["focal_px"]), tuple(center) if center else None)


def _extent(position: np.ndarray) -> tuple[float, float, float, float]:
    known = position[np.isfinite(position).all(axis=1)]
    if not len(known):
        return (0.0, 0.0, 0.0, 0.0)
    (x_min, y_min), (x_max, y_max) = known.min(axis=0), known.max(axis=0)
    return (float(x_min), float(x_max), float(y_min), float(y_max))


def _read_header(path: Path, reading: Reading) -> dict | None:
    try:
        header = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError:
        reading.faults.append(f"{path}: not found: a flight folder needs flight.toml with at least a name")
        return None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        reading.faults.append(f"{path}: not valid TOML ({error}): correct it")
        return None
    faults = []
    if unknown := sorted(set(header) - _TOP):
        faults.append(f"unknown key {unknown[0]!r}: the keys are {', '.join(sorted(_TOP))}")
    if header.get("format", FORMAT) > FORMAT:
        faults.append(f"format {header['format']} is newer than {FORMAT}, the newest this version reads: update trexton")
    area = header.get("area_m", [0, 1, 0, 1])
    if len(area) != 4 or not np.isfinite(area).all() or area[0] >= area[1] or area[2] >= area[3]:
        faults.append(f"area_m is {area}: expected [x_min, x_max, y_min, y_max] in metres")
    for key, value in header.get("split", {}).items():
        if not (isinstance(value, list) and len(value) == 2 and value[0] <= value[1]):
            faults.append(f"split {key!r} is {value}: expected [first frame, last frame]")
    if missing := [key for key in ("width_px", "height_px", "focal_px") if key not in header.get("camera", {key: 0})]:
        faults.append(f"[camera] lacks {missing[0]}: give width_px, height_px and focal_px, or drop the table")
    if missing := [key for key in ("image", "world_from_pixel") if key not in header.get("floor", {key: 0})]:
        faults.append(f"[floor] lacks {missing[0]}: give image and world_from_pixel, or drop the table")
    reading.faults += [f"{path}: {fault}" for fault in faults]
    return None if faults else header


def _rows(path: Path, reading: Reading) -> tuple[list[str], list[list[str]]] | None:
    try:
        with open(path, newline="", encoding="utf-8") as stream:
            table = list(csv.reader(stream))
    except OSError:
        reading.faults.append(f"{path}: not found: a flight folder needs it")
        return None
    except (UnicodeDecodeError, csv.Error) as error:
        reading.faults.append(f"{path}: not a text table ({error}): write it as UTF-8 CSV")
        return None
    if len(table) < 2:
        reading.faults.append(f"{path}: no frames: expected a header and at least one row")
        return None
    header, rows = [name.strip() for name in table[0]], table[1:]
    for number, row in enumerate(rows, start=2):
        if len(row) != len(header):
            reading.faults.append(f"{path}, row {number}: {len(row)} fields where the header names {len(header)}: complete the row")
            return None
    return header, rows


def _numbers(path: Path, name: str, cells: list[str], reading: Reading, missing_allowed: bool) -> np.ndarray:
    values = np.full(len(cells), np.nan)
    for index, cell in enumerate(cells):
        try:
            values[index] = float(cell) if cell.strip() else np.nan
        except ValueError:
            reading.faults.append(f"{path}, row {index + 2}: {name} is {cell!r}: expected a number")
            return values
        if np.isinf(values[index]) or (np.isnan(values[index]) and not missing_allowed):
            reading.faults.append(f"{path}, row {index + 2}: {name} is {cell or 'empty'}: expected a finite number")
            return values
    return values


def _read_frames(path: Path, reading: Reading) -> dict[str, np.ndarray] | None:
    table = _rows(path, reading)
    if table is None:
        return None
    header, rows = table
    if missing := [name for name in _REQUIRED if name not in header]:
        reading.faults.append(f"{path}: column {missing[0]!r} is missing: expected {','.join(_REQUIRED)} and optionally {','.join(_OPTIONAL)}")
    if unknown := [name for name in header if name not in _REQUIRED + _OPTIONAL]:
        reading.faults.append(f"{path}: unknown column {unknown[0]!r}: expected {','.join(_REQUIRED)} and optionally {','.join(_OPTIONAL)}")
    if reading.faults:
        return None
    columns: dict = {}
    for place, name in enumerate(header):
        cells = [row[place] for row in rows]
        if name == "image":
            columns[name] = cells
        else:
            columns[name] = _numbers(path, name, cells, reading, missing_allowed=name not in ("frame", "t_s"))
    if reading.faults:
        return None
    columns["frame"] = columns["frame"].astype(np.int64)
    for name, what in (("t_s", "stamp"), ("frame", "frame number")):
        for row in np.flatnonzero(np.diff(columns[name]) <= 0):
            kind = "duplicated" if columns[name][row] == columns[name][row + 1] else "unsorted"
            reading.faults.append(f"{path}, row {row + 3}: {kind} {what} {columns[name][row + 1]:g}: they must increase")
    for row in np.flatnonzero(np.isnan(columns["x_m"]) | np.isnan(columns["y_m"])):
        reading.warnings.append(f"{path}, row {row + 2}: the position is missing or NaN: the frame cannot train and has no ground truth")
    return columns


def _read_histograms(path: Path, frames: np.ndarray, reading: Reading) -> np.ndarray | None:
    table = _rows(path, reading)
    if table is None:
        return None
    header, rows = table
    if header[0] != "frame" or header[1:] != [f"t{i}" for i in range(len(header) - 1)] or len(header) < 2:
        reading.faults.append(f"{path}: unknown columns {','.join(header[:4])}...: expected frame,t0,t1,...")
        return None
    columns = [_numbers(path, name, [row[i] for row in rows], reading, False) for i, name in enumerate(header)]
    values = np.column_stack(columns)
    if reading.faults:
        return None
    if not np.array_equal(values[:, 0], frames):
        odd = next((i for i, (a, b) in enumerate(zip(values[:, 0], frames)) if a != b), min(len(values), len(frames)))
        reading.faults.append(f"{path}, row {odd + 2}: its frames differ from those of frames.csv ({len(values)} rows against {len(frames)}): list the same frames in the same order")
        return None
    histograms = values[:, 1:]
    for row in np.flatnonzero((histograms < 0).any(axis=1) | (np.abs(histograms.sum(axis=1) - 1) > SUM_TOLERANCE)):
        reading.faults.append(f"{path}, row {row + 2}: the histogram sums to {histograms[row].sum():.4g} (smallest entry {histograms[row].min():.4g}): expected relative frequencies that sum to 1 within {SUM_TOLERANCE:.0%}")
    return histograms


def write_flight(flight: Flight, path: str | os.PathLike) -> Path:
    """Write `flight` as a folder, whole or not at all; images and floor are copied as they are."""
    path = Path(path)
    with atomic_folder(path) as folder:
        if flight.image_files is not None:
            (folder / "images").mkdir()
            for file in flight.image_files:
                shutil.copyfile(file, folder / "images" / file.name)
        if flight.floor_file is not None:
            shutil.copyfile(flight.floor_file, folder / flight.floor_file.name)
        write_tables(flight, folder)
    return path


def write_tables(flight: Flight, folder: Path) -> None:
    """Write flight.toml, frames.csv and histograms.csv of `flight` into an existing folder."""
    (folder / "flight.toml").write_text(_header_text(flight), encoding="utf-8")
    columns: dict = {"frame": flight.frame, "t_s": flight.time, "x_m": flight.position[:, 0], "y_m": flight.position[:, 1]}
    if flight.height is not None:
        columns["z_m"] = flight.height
    if flight.attitude is not None:
        columns |= dict(zip(("roll_rad", "pitch_rad", "yaw_rad"), flight.attitude.T))
    if flight.image_files is not None:
        columns["image"] = [file.name for file in flight.image_files]
    _write_csv(folder / "frames.csv", columns)
    if flight.histograms is not None:
        textons = {f"t{i}": column for i, column in enumerate(flight.histograms.T)}
        _write_csv(folder / "histograms.csv", {"frame": flight.frame, **textons})


def _write_csv(path: Path, columns: dict) -> None:
    with open(path, "w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        # repr of a Python float reads back to the same bits
        writer.writerows(zip(*(values.tolist() if isinstance(values, np.ndarray) else values for values in columns.values())))


def _header_text(flight: Flight) -> str:
    def text(value: str) -> str:
        import json

        return json.dumps(value, ensure_ascii=False)  # a JSON string is a valid TOML basic string

    lines = [f"format = {FORMAT}", f"name = {text(flight.name)}", f"source = {text(flight.source)}", f"licence = {text(flight.licence)}"]
    lines.append(f"area_m = {[float(value) for value in flight.area]}")
    if flight.notes:
        lines.append(f"notes = [{', '.join(text(note) for note in flight.notes)}]")
    if flight.split:
        lines += ["", "[split]"] + [f"{text(key)} = [{first}, {last}]" for key, (first, last) in flight.split.items()]
    if flight.camera is not None:
        camera = flight.camera
        lines += ["", "[camera]", f"width_px = {camera.width}", f"height_px = {camera.height}", f"focal_px = {float(camera.focal)}"]
        lines.append(f"center_px = {[float(value) for value in camera.principal_point]}")
    if flight.floor_file is not None:
        matrix = np.asarray(flight.floor_from_pixel, dtype=float).tolist()
        lines += ["", "[floor]", f"image = {text(flight.floor_file.name)}", f"world_from_pixel = {matrix}"]
    return "\n".join(lines) + "\n"
