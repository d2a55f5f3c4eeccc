"""The Flight folder: ``flight.toml``, ``frames.csv``, and optionally ``images/`` and ``histograms.csv``.

Reading collects every fault with its file and row; `read_flight` raises on the first, `trexton check` prints
them all.
"""

from __future__ import annotations

import csv
import os
import shutil
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from trexton.errors import FlightError
from trexton.files import atomic_folder
from trexton.flights.flight import Flight
from trexton.flights.header import camera_from_header, header_text, read_header

__all__ = ["Reading", "load_folder", "read_flight", "write_flight", "write_tables"]

_REQUIRED = ("frame", "t_s", "x_m", "y_m")
_OPTIONAL = ("z_m", "roll_rad", "pitch_rad", "yaw_rad", "image")
_COLUMNS = f"{','.join(_REQUIRED)} and optionally {','.join(_OPTIONAL)}"
SUM_TOLERANCE = 0.01
MARKER = "flight.toml"  # what makes a folder one of ours, which may be replaced


@dataclass
class Reading:
    """What a folder gave: a flight if it is usable, and its faults as sentences (file, row, what is wrong).

    `image_files`: the images that are there with their rows in frames.csv, of an unusable flight too.
    """

    flight: Flight | None = None
    faults: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    image_files: list[tuple[int, Path]] = field(default_factory=list)


def read_flight(path: str | os.PathLike) -> Flight:
    """Read a Flight folder; missing positions are allowed (NaN), everything else must be sound.

    Raises
    ------
    FlightError
        Naming the file, the row and the first fault.
    """
    reading = load_folder(Path(path))
    if reading.faults:
        more = (
            f" (and {len(reading.faults) - 1} more: trexton check {path})"
            if len(reading.faults) > 1
            else ""
        )
        raise FlightError(reading.faults[0] + more)
    return reading.flight


def load_folder(path: Path) -> Reading:
    """Read a Flight folder and collect its faults instead of raising."""
    reading = Reading()
    if not path.is_dir():
        reading.faults.append(f"{path}: no such folder: give the folder that holds flight.toml")
        return reading
    header, reading.faults = read_header(path / "flight.toml")
    columns = _read_frames(path / "frames.csv", reading)
    if columns is None:
        return reading
    histograms = None
    if (path / "histograms.csv").exists():
        features = (header or {}).get("features", "textons")
        histograms = _read_histograms(path / "histograms.csv", columns["frame"], features, reading)
    elif "image" not in columns:
        reading.faults.append(
            f"{path}: neither images nor histograms.csv found: a flight needs at least one of them"
        )
    files = _find_images(path, columns.get("image"), reading)
    _check_split(path / "flight.toml", header, columns["frame"], reading)
    if header and "floor" in header:
        floor = (path / header["floor"]["image"]).resolve()
        if path.resolve() not in floor.parents:
            reading.faults.append(
                f"{path / 'flight.toml'}: [floor] image {header['floor']['image']!r} leads out of the "
                "flight's folder: copy the picture into it"
            )
    if not reading.faults and header is not None:
        reading.flight = _assemble(path, header, columns, files, histograms)
    return reading


def _find_images(path: Path, names: list[str] | None, reading: Reading) -> tuple[Path, ...] | None:
    if names is None:
        return None
    files = tuple(path / "images" / name for name in names)
    inside = (path / "images").resolve()
    for row, (name, file) in enumerate(zip(names, files), start=2):
        if name and inside not in file.resolve().parents:
            reading.faults.append(
                f"{path / 'frames.csv'}, row {row}: image {name!r} leads out of {path / 'images'}: "
                "copy the file into the flight"
            )
        elif name and file.is_file():
            reading.image_files.append((row, file))
        else:
            found = f"image {name!r} is not in {path / 'images'}" if name else "no image is named"
            reading.faults.append(
                f"{path / 'frames.csv'}, row {row}: {found}: add the file or drop the row"
            )
    return files


def _check_split(path: Path, header: dict | None, frames: np.ndarray, reading: Reading) -> None:
    for name, (first, last) in (header or {}).get("split", {}).items():
        if not ((frames >= first) & (frames <= last)).any():
            reading.faults.append(
                f"{path}: split {name!r} is {first} to {last}, but the frames are {frames[0]} to {frames[-1]}: correct it"
            )


def _assemble(path: Path, header: dict, columns: dict, files, histograms) -> Flight:
    position = np.column_stack([columns["x_m"], columns["y_m"]])
    angles = [columns.get(name) for name in ("roll_rad", "pitch_rad", "yaw_rad")]
    floor = header.get("floor")
    return Flight(
        name=header.get("name", path.name),
        frame=columns["frame"],
        time=columns["t_s"],
        position=position,
        area=tuple(float(value) for value in header["area_m"])
        if "area_m" in header
        else _extent(position),
        height=columns.get("z_m"),
        attitude=None if any(angle is None for angle in angles) else np.column_stack(angles),
        image_files=files,
        histograms=histograms,
        features=header.get("features", "textons"),
        camera=camera_from_header(header["camera"]) if "camera" in header else None,
        split={key: (first, last) for key, (first, last) in header.get("split", {}).items()},
        floor_file=path / floor["image"] if floor else None,
        floor_from_pixel=np.array(floor["world_from_pixel"], dtype=float) if floor else None,
        source=header.get("source", ""),
        licence=header.get("licence", ""),
        notes=tuple(header.get("notes", ())),
    )


def _extent(position: np.ndarray) -> tuple[float, float, float, float]:
    known = position[np.isfinite(position).all(axis=1)]
    if not len(known):
        return (0.0, 0.0, 0.0, 0.0)
    (x_min, y_min), (x_max, y_max) = known.min(axis=0), known.max(axis=0)
    return (float(x_min), float(x_max), float(y_min), float(y_max))


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
            reading.faults.append(
                f"{path}, row {number}: {len(row)} fields where the header names {len(header)}: complete the row"
            )
            return None
    return header, rows


def _numbers(
    path: Path, name: str, cells: list[str], reading: Reading, missing_allowed: bool
) -> np.ndarray:
    values = np.full(len(cells), np.nan)
    for index, cell in enumerate(cells):
        try:
            values[index] = float(cell) if cell.strip() else np.nan
        except ValueError:
            reading.faults.append(f"{path}, row {index + 2}: {name} is {cell!r}: expected a number")
            return values
        if np.isinf(values[index]) or (np.isnan(values[index]) and not missing_allowed):
            reading.faults.append(
                f"{path}, row {index + 2}: {name} is {cell or 'empty'}: expected a finite number"
            )
            return values
    return values


def _read_frames(path: Path, reading: Reading) -> dict | None:
    table = _rows(path, reading)
    if table is None:
        return None
    header, rows = table
    before = len(reading.faults)
    if unknown := [name for name in header if name not in _REQUIRED + _OPTIONAL]:
        reading.faults.append(f"{path}: unknown column {unknown[0]!r}: expected {_COLUMNS}")
    if missing := [name for name in _REQUIRED if name not in header]:
        reading.faults.append(f"{path}: column {missing[0]!r} is missing: expected {_COLUMNS}")
    if twice := [name for name in header if header.count(name) > 1]:
        reading.faults.append(f"{path}: column {twice[0]!r} appears twice: expected {_COLUMNS}")
    if len(reading.faults) > before:
        return None
    columns: dict = {}
    for place, name in enumerate(header):
        cells = [row[place] for row in rows]
        if name == "image":
            columns[name] = cells
        else:
            columns[name] = _numbers(
                path, name, cells, reading, missing_allowed=name not in ("frame", "t_s")
            )
    if len(reading.faults) > before:
        return None
    for row in np.flatnonzero(columns["frame"] % 1):
        reading.faults.append(
            f"{path}, row {row + 2}: frame is {columns['frame'][row]:g}: expected a whole number"
        )
    columns["frame"] = columns["frame"].astype(np.int64)
    _check_order(path, columns, reading)
    for row in np.flatnonzero(np.isnan(columns["x_m"]) | np.isnan(columns["y_m"])):
        reading.warnings.append(
            f"{path}, row {row + 2}: the position is missing or NaN: the frame cannot train and has no ground truth"
        )
    return columns


def _check_order(path: Path, columns: dict, reading: Reading) -> None:
    for name, what in (("t_s", "stamp"), ("frame", "frame number")):
        values = columns[name]
        for row in np.flatnonzero(np.diff(values) <= 0):
            kind = "duplicated" if values[row] == values[row + 1] else "unsorted"
            reading.faults.append(
                f"{path}, row {row + 3}: {kind} {what} {values[row + 1]:g}: they must increase"
            )


def _read_histograms(
    path: Path, frames: np.ndarray, features: str, reading: Reading
) -> np.ndarray | None:
    table = _rows(path, reading)
    if table is None:
        return None
    header, rows = table
    if (
        header[0] != "frame"
        or header[1:] != [f"t{i}" for i in range(len(header) - 1)]
        or len(header) < 2
    ):
        reading.faults.append(
            f"{path}: unknown columns {','.join(header[:4])}...: expected frame,t0,t1,..."
        )
        return None
    before = len(reading.faults)
    values = np.column_stack(
        [
            _numbers(path, name, [row[i] for row in rows], reading, missing_allowed=False)
            for i, name in enumerate(header)
        ]
    )
    if len(reading.faults) > before:
        return None
    if not np.array_equal(values[:, 0], frames):
        odd = next(
            (i for i, (a, b) in enumerate(zip(values[:, 0], frames)) if a != b),
            min(len(values), len(frames)),
        )
        reading.faults.append(
            f"{path}, row {odd + 2}: its frames differ from those of frames.csv "
            f"({len(values)} rows against {len(frames)}): "
            "list the same frames in the same order"
        )
        return None
    histograms = values[:, 1:]
    if features != "textons":
        return histograms
    sums = histograms.sum(axis=1)
    for row in np.flatnonzero((histograms < 0).any(axis=1) | (np.abs(sums - 1) > SUM_TOLERANCE)):
        reading.faults.append(
            f"{path}, row {row + 2}: the histogram sums to {sums[row]:.4g} "
            f"(smallest entry {histograms[row].min():.4g}): "
            f"expected relative frequencies that sum to 1 within {SUM_TOLERANCE:.0%}, or "
            'features = "..." in the header for other features'
        )
    return histograms


def write_flight(flight: Flight, path: str | os.PathLike) -> Path:
    """Write `flight` as a folder, whole or not at all; images and floor are copied as they are."""
    path = Path(path)
    with atomic_folder(path, MARKER) as folder:
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
    (folder / "flight.toml").write_text(header_text(flight), encoding="utf-8")
    columns: dict = {
        "frame": flight.frame,
        "t_s": flight.time,
        "x_m": flight.position[:, 0],
        "y_m": flight.position[:, 1],
    }
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
    lists = [
        values.tolist() if isinstance(values, np.ndarray) else values for values in columns.values()
    ]
    with open(path, "w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(columns)
        writer.writerows(zip(*lists))  # str of a Python float reads back to the same bits
