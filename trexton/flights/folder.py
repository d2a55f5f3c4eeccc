"""The Flight folder: ``flight.toml``, ``frames.csv``, and optionally ``images/`` and
``histograms.csv``.

Reading collects every fault with its file and row; `read_flight` raises on the first, `trexton
check` prints them all.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import FlightError
from trexton.flights.flight import Flight, area_around
from trexton.flights.frames import ImageFiles
from trexton.flights.header import FARTHEST, read_header
from trexton.flights.tables import TextTable, counted_on, read_table
from trexton.vision.camera import Camera, Rectification
from trexton.vision.histograms import SUM_TOLERANCE

_REQUIRED = ("frame", "t_s", "x_m", "y_m")
ANGLES = ("roll_rad", "pitch_rad", "yaw_rad")
_OPTIONAL = ("z_m", *ANGLES, "image")
_COLUMNS = f"{','.join(_REQUIRED)} and optionally {','.join(_OPTIONAL)}"

Columns = dict[str, Any]


@dataclass
class Reading:
    """What a folder gave: a flight if it is usable, and its faults as sentences (file, row, what is
    wrong).

    `image_files`: the images that are there with their rows in frames.csv, of an unusable flight
    too.
    """

    flight: Flight | None = None
    faults: list[str] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    image_files: list[tuple[int, Path]] = field(default_factory=list)

    def refuse(
        self, path: Path, rows: np.ndarray, wrong: np.ndarray, found: Callable[[int], str]
    ) -> None:
        """A fault where rows are `wrong`: what was found in the first, and in how many."""
        if wrong.any():
            first = int(wrong.argmax())
            self.faults.append(f"{path}, row {rows[first]}: {found(first)}{_more(rows[wrong])}")


def _more(rows: np.ndarray) -> str:
    return f" (and {len(rows) - 1} more like it, the last in row {rows[-1]})" * (len(rows) > 1)


def read_flight(path: str | os.PathLike[str]) -> Flight:
    """Read a Flight folder; missing positions are allowed (NaN), everything else must be sound.

    Raises
    ------
    FlightError
        Naming the file, the row and the first fault.
    """
    reading = load_folder(Path(path))
    if reading.flight is None:
        more = len(reading.faults) - 1
        words = f" (and {more} more: trexton check {path})" if more else ""
        raise FlightError(reading.faults[0] + words)
    return reading.flight


def load_folder(path: Path, repaired: list[str] | None = None) -> Reading:
    """Read a Flight folder and collect its faults instead of raising.

    Where a list `repaired` is given, rows out of order are sorted instead, and it says so.
    """
    reading = Reading()
    if not path.is_dir():
        reading.faults.append(f"{path}: no such folder: give the folder that holds flight.toml")
        return reading
    header, reading.faults = read_header(path / "flight.toml")
    declared = header or {}
    try:
        table = read_table(path / "frames.csv")
        columns = _columns(table, reading)
    except FlightError as error:
        reading.faults.append(str(error))
        return reading
    listed, order = columns["frame"], np.arange(len(table))
    if repaired is not None:
        place = np.column_stack([columns["x_m"], columns["y_m"]])
        columns["t_s"], back = counted_on(columns["t_s"], place)
        repaired += [
            f"stamps counted on from frame {listed[row]}, a clock set back" for row in back
        ]
        order = np.unique(columns["t_s"], return_index=True)[1]
        columns = _sorted(columns, order, repaired)
    rows, histograms = np.array(table.rows)[order], None
    names: tuple[str, ...] = ()
    _check_rows(path / "frames.csv", columns, rows, reading)
    if (path / "histograms.csv").exists():
        try:
            file = path / "histograms.csv"
            names, histograms = _read_histograms(file, listed, declared, reading)
            histograms = histograms[order]
        except FlightError as error:
            reading.faults.append(str(error))
    elif "image" not in columns:
        reading.faults.append(
            f"{path}: neither images nor histograms.csv found: a flight needs at least one of them"
        )
    files = _find_images(path, columns.get("image"), rows, reading)
    frames = columns["frame"]
    for name, (first, last) in declared.get("split", {}).items():
        if not ((frames >= first) & (frames <= last)).any():
            reading.faults.append(
                f"{path / 'flight.toml'}: split {name!r} is {first} to {last}, but the frames are "
                f"{frames[0]} to {frames[-1]}: correct it"
            )
    if "floor" in declared and not _inside(path, path / declared["floor"]["image"]):
        reading.faults.append(
            f"{path / 'flight.toml'}: [floor] image {declared['floor']['image']!r} leads out of "
            "the flight's folder: copy the picture into it"
        )
    if not reading.faults:
        reading.flight = _assemble(path, declared, columns, files, names, histograms)
    return reading


def _columns(table: TextTable, reading: Reading) -> Columns:
    """The columns of frames.csv, in the order of the file."""
    path, header, columns = table.path, table.header, {}
    odd = [f"unknown column {name!r}" for name in header if name not in _REQUIRED + _OPTIONAL]
    odd += [f"column {name!r} is missing" for name in _REQUIRED if name not in header]
    if odd:
        raise FlightError(f"{path}: {odd[0]}: expected {_COLUMNS}")
    for name in header:
        needed = name in ("frame", "t_s")
        if name == "image":
            columns[name] = np.array(table.texts(name), dtype=object)
            continue
        columns[name] = table.numbers(name, missing_allowed=not needed)
        if needed and (most := np.abs(columns[name]).max()) > 2**53:
            raise FlightError(
                f"{path}: {name} reaches {most:g}: count from the first frame, in seconds"
            )
    frame = columns["frame"]
    reading.refuse(
        path, np.array(table.rows), frame % 1 != 0,
        lambda row: f"frame is {frame[row]:g}: expected a whole number",
    )  # fmt: skip
    columns["frame"] = frame.astype(np.int64)
    return columns


def _sorted(columns: Columns, order: np.ndarray, said: list[str]) -> Columns:
    """The rows in order of their stamps, one a stamp; frame numbers that then go back are counted
    anew.
    """
    time = columns["t_s"]
    if not np.array_equal(order, np.arange(len(time))):
        back, twice = int((np.diff(time) < 0).sum()), len(time) - len(order)
        said.append(f"{back} rows put in order of their stamps, {twice} of repeated stamps dropped")
        columns = {name: values[order] for name, values in columns.items()}
    if (np.diff(columns["frame"]) <= 0).any():
        said.append("frames numbered anew")
        columns["frame"] = np.arange(len(order))
    return columns


def _check_rows(path: Path, columns: Columns, rows: np.ndarray, reading: Reading) -> None:
    for name, what in (("t_s", "stamp"), ("frame", "frame number")):
        values = columns[name]
        steps = np.diff(values, prepend=-np.inf)
        row = int((steps <= 0).argmax())
        order = "unsorted" if steps[row] else "duplicated"
        found = f"{order} {what} {values[row]}: they must increase"
        reading.refuse(path, rows, steps <= 0, lambda _, found=found: found)  # type: ignore[misc]
    place = np.abs(np.column_stack([columns["x_m"], columns["y_m"]])).max(axis=1)
    if (unknown := rows[np.isnan(place)]).size:
        reading.warnings.append(
            f"{path}, row {unknown[0]}: the position is missing or NaN: the frame cannot train and "
            f"has no ground truth{_more(unknown)}"
        )
    reading.refuse(
        path, rows, place > FARTHEST,
        lambda row: f"the position is {place[row]:g} m from the origin: no such place on Earth, "
        "leave it empty or give metres",
    )  # fmt: skip


def _inside(folder: Path, file: Path) -> bool:
    return folder.resolve() in file.resolve().parents


def _find_images(
    path: Path, names: np.ndarray | None, rows: np.ndarray, reading: Reading
) -> tuple[Path, ...] | None:
    """The files named; regular files below ``images/`` only, links too if they stay there."""
    if names is None:
        return None
    folder = path / "images"
    files = tuple(folder / name for name in names)
    there = np.array([os.path.isfile(file) and _inside(folder, file) for file in files])
    reading.image_files = [(int(rows[row]), files[row]) for row in np.flatnonzero(there)]

    def found(row: int) -> str:
        out = names[row] and os.path.exists(files[row])
        how = "leads out of" if out else "is not in"
        return f"image {names[row]!r} {how} {folder}: copy the file there or drop the row"

    reading.refuse(path / "frames.csv", rows, ~there, found)
    return files


def _assemble(
    path: Path,
    header: Columns,
    columns: Columns,
    files: tuple[Path, ...] | None,
    names: tuple[str, ...],
    histograms: np.ndarray | None,
) -> Flight:
    position = np.column_stack([columns["x_m"], columns["y_m"]])
    x_min, x_max, y_min, y_max = header.get("area_m") or area_around(position)
    unknown = np.full(len(position), np.nan)  # a heading may be known where no tilt is
    angles = [columns.get(name, unknown) for name in ANGLES]
    camera, floor, rectified, origin = map(
        header.get, ("camera", "floor", "rectification", "origin")
    )
    return Flight(
        name=header.get("name", path.name), frame=columns["frame"], time=columns["t_s"],
        position=position, area=(float(x_min), float(x_max), float(y_min), float(y_max)),
        height=columns.get("z_m"),
        attitude=np.column_stack(angles) if columns.keys() & set(ANGLES) else None,
        frames=None if files is None else ImageFiles(files), histograms=histograms,
        features=header.get("features", "textons"), feature_names=names,
        camera=camera and Camera(
            camera["width_px"], camera["height_px"], float(camera["focal_px"]),
            tuple(camera["center_px"]) if camera.get("center_px") else None,
        ),
        split={key: (first, last) for key, (first, last) in header.get("split", {}).items()},
        floor_file=path / floor["image"] if floor else None,
        floor_from_pixel=np.array(floor["world_from_pixel"], dtype=float) if floor else None,
        rectification=Rectification.from_table(rectified) if rectified else None,
        origin=(float(origin["latitude_deg"]), float(origin["longitude_deg"])) if origin else None,
        source=header.get("source", ""), licence=header.get("licence", ""),
        notes=tuple(header.get("notes", ())),
    )  # fmt: skip


def _read_histograms(
    path: Path, frames: np.ndarray, header: Columns, reading: Reading
) -> tuple[tuple[str, ...], np.ndarray]:
    """The names of the features, none where they are but counted, and ``(N, K)`` values."""
    table = read_table(path)
    names, rows = table.header, np.array(table.rows)
    if len(names) < 2 or names[0] != "frame":
        raise FlightError(
            f"{path}: unknown columns {','.join(names[:4])}...: expected frame, then one a feature"
        )
    values = np.column_stack([table.numbers(name, missing_allowed=False) for name in names])
    if not np.array_equal(values[:, 0], frames):
        common = min(len(values), len(frames))
        odd = int(np.argmin([*(values[:common, 0] == frames[:common]), False]))
        raise FlightError(
            f"{path}, row {[*rows, rows[-1] + 1][odd]}: its frames differ from those of "
            f"frames.csv ({len(values)} rows against {len(frames)}): list the same frames in "
            "the same order"
        )
    histograms = values[:, 1:]
    if header.get("features", "textons") == "textons":
        sums, least = histograms.sum(axis=1), histograms.min(axis=1)
        reading.refuse(
            path, rows, (least < 0) | (np.abs(sums - 1) > SUM_TOLERANCE),
            lambda row: f"the histogram sums to {sums[row]:.4g} (smallest entry {least[row]:.4g}): "
            f"expected relative frequencies that sum to 1 within {SUM_TOLERANCE:.0%}, or "
            'features = "..." in the header for other features',
        )  # fmt: skip
    counted = names[1:] == [f"t{column}" for column in range(len(names) - 1)]
    return () if counted else tuple(names[1:]), histograms
