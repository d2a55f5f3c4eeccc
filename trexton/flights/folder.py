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
from trexton.flights.flight import SUM_TOLERANCE, Flight, area_around
from trexton.flights.frames import ImageFiles
from trexton.flights.header import FARTHEST, read_header
from trexton.flights.tables import read_table
from trexton.vision.camera import Camera
from trexton.vision.rectification import Rectification

__all__ = ["ANGLES", "Reading", "load_folder", "read_flight"]

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
    repaired: list[str] | None = None
    listed: np.ndarray = field(default_factory=lambda: np.zeros(0, int))  # frames as in the file
    order: np.ndarray | None = None  # of the rows, where they were sorted

    def refuse(
        self, path: Path, rows: np.ndarray, wrong: np.ndarray, found: Callable[[int], str]
    ) -> None:
        """A fault for each row where `wrong`, with what was found there."""
        for row in np.flatnonzero(wrong).tolist():
            self.faults.append(f"{path}, row {rows[row]}: {found(row)}")


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
    reading = Reading(repaired=repaired)
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
        histograms = _read_histograms(path / "histograms.csv", features, reading)
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
                f"{path / 'flight.toml'}: [floor] image {header['floor']['image']!r} leads out of "
                "the flight's folder: copy the picture into it"
            )
    if not reading.faults and header is not None:
        reading.flight = _assemble(path, header, columns, files, histograms)
    return reading


def _find_images(path: Path, names: list[str] | None, reading: Reading) -> tuple[Path, ...] | None:
    """The files named; regular files below ``images/`` only, links too if they stay there."""
    if names is None:
        return None
    folder = path / "images"
    files, top = tuple(folder / name for name in names), folder.resolve()
    for row, (name, file) in enumerate(zip(names, files, strict=True), start=2):
        if name and os.path.isfile(file) and top in file.resolve().parents:
            reading.image_files.append((row, file))
            continue
        if not name:
            found = "no image is named: add the file or drop the row"
        elif os.path.exists(file):
            found = f"image {name!r} leads out of {folder}: copy the file into the flight"
        else:
            found = f"image {name!r} is not in {folder}: add the file or drop the row"
        reading.faults.append(f"{path / 'frames.csv'}, row {row}: {found}")
    return files


def _check_split(path: Path, header: Columns | None, frames: np.ndarray, reading: Reading) -> None:
    for name, (first, last) in (header or {}).get("split", {}).items():
        if not ((frames >= first) & (frames <= last)).any():
            reading.faults.append(
                f"{path}: split {name!r} is {first} to {last}, but the frames are {frames[0]} to "
                f"{frames[-1]}: correct it"
            )


def _assemble(
    path: Path,
    header: Columns,
    columns: Columns,
    files: tuple[Path, ...] | None,
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
        name=header.get("name", path.name),
        frame=columns["frame"],
        time=columns["t_s"],
        position=position,
        area=(float(x_min), float(x_max), float(y_min), float(y_max)),
        height=columns.get("z_m"),
        attitude=np.column_stack(angles) if columns.keys() & set(ANGLES) else None,
        frames=None if files is None else ImageFiles(files),
        histograms=histograms,
        features=header.get("features", "textons"),
        camera=camera and Camera(
            camera["width_px"], camera["height_px"], float(camera["focal_px"]),
            tuple(camera["center_px"]) if camera.get("center_px") else None,
        ),
        split={key: (first, last) for key, (first, last) in header.get("split", {}).items()},
        floor_file=path / floor["image"] if floor else None,
        floor_from_pixel=np.array(floor["world_from_pixel"], dtype=float) if floor else None,
        rectification=Rectification.from_table(rectified) if rectified else None,
        origin=(float(origin["latitude_deg"]), float(origin["longitude_deg"])) if origin else None,
        source=header.get("source", ""),
        licence=header.get("licence", ""),
        notes=tuple(header.get("notes", ())),
    )  # fmt: skip


def _read_frames(path: Path, reading: Reading) -> Columns | None:
    try:
        table = read_table(path)
    except FlightError as error:
        reading.faults.append(str(error))
        return None
    reading.warnings += table.unusual()
    header, rows = table.header, np.array(table.rows)
    before = len(reading.faults)
    if unknown := [name for name in header if name not in _REQUIRED + _OPTIONAL]:
        reading.faults.append(f"{path}: unknown column {unknown[0]!r}: expected {_COLUMNS}")
    if missing := [name for name in _REQUIRED if name not in header]:
        reading.faults.append(f"{path}: column {missing[0]!r} is missing: expected {_COLUMNS}")
    columns: Columns = {}
    for name in header if len(reading.faults) == before else ():
        try:
            needed = name in ("frame", "t_s")
            columns[name] = (
                table.texts(name)
                if name == "image"
                else table.numbers(name, missing_allowed=not needed)
            )
            if needed and np.abs(columns[name]).max() > 2**53:
                raise FlightError(
                    f"{path}: {name} reaches {np.abs(columns[name]).max():g}: "
                    "count from the first frame, in seconds"
                )
        except FlightError as error:
            reading.faults.append(str(error))
    if len(reading.faults) > before:
        return None
    frame = columns["frame"]
    reading.refuse(
        path, rows, frame % 1 != 0, lambda row: f"frame is {frame[row]:g}: expected a whole number"
    )
    columns["frame"] = frame.astype(np.int64)
    reading.listed = columns["frame"]
    if reading.repaired is not None:
        _sort(columns, reading.repaired, reading)
        rows = rows[reading.order] if reading.order is not None else rows
    _check_rows(path, columns, rows, reading)
    return columns


def _check_rows(path: Path, columns: Columns, rows: np.ndarray, reading: Reading) -> None:
    for name, what in (("t_s", "stamp"), ("frame", "frame number")):
        steps = np.diff(columns[name], prepend=-np.inf)
        reading.refuse(
            path, rows, steps <= 0,
            lambda row, steps=steps, what=what, name=name: (  # type: ignore[misc]
                f"{'unsorted' if steps[row] else 'duplicated'} {what} {columns[name][row]}: "
                "they must increase"
            ),
        )  # fmt: skip
    place = np.abs(np.column_stack([columns["x_m"], columns["y_m"]])).max(axis=1)
    for row in np.flatnonzero(np.isnan(place)):
        reading.warnings.append(
            f"{path}, row {rows[row]}: the position is missing or NaN: the frame cannot train and "
            "has no ground truth"
        )
    reading.refuse(
        path, rows, place > FARTHEST,
        lambda row: f"the position is {place[row]:g} m from the origin: no such place on Earth, "
        "leave it empty or give metres",
    )  # fmt: skip


def _sort(columns: Columns, said: list[str], reading: Reading) -> None:
    """Put the rows in order of their stamps, one a stamp; frame numbers that then go back are
    counted anew.
    """
    time = columns["t_s"]
    order = np.unique(time, return_index=True)[1]
    if not np.array_equal(order, np.arange(len(time))):
        back, twice = int((np.diff(time) < 0).sum()), len(time) - len(order)
        said.append(f"{back} rows put in order of their stamps, {twice} of repeated stamps dropped")
        reading.order = order
        for name, values in columns.items():
            columns[name] = [values[i] for i in order] if name == "image" else values[order]
    if (np.diff(columns["frame"]) <= 0).any():
        said.append("frames numbered anew")
        columns["frame"] = np.arange(len(order))


def _read_histograms(path: Path, features: str, reading: Reading) -> np.ndarray | None:
    frames = reading.listed
    try:
        table = read_table(path)
        header, rows = table.header, np.array(table.rows)
        if len(header) < 2 or header != ["frame", *(f"t{i}" for i in range(len(header) - 1))]:
            raise FlightError(
                f"{path}: unknown columns {','.join(header[:4])}...: expected frame,t0,t1,..."
            )
        values = np.column_stack([table.numbers(name, missing_allowed=False) for name in header])
    except FlightError as error:
        reading.faults.append(str(error))
        return None
    reading.warnings += table.unusual()
    if not np.array_equal(values[:, 0], frames):
        common = min(len(values), len(frames))
        odd = int(np.argmin([*(values[:common, 0] == frames[:common]), False]))
        reading.faults.append(
            f"{path}, row {rows[odd] if odd < len(rows) else rows[-1] + 1}: its frames differ from "
            f"those of frames.csv ({len(values)} rows against {len(frames)}): list the same frames "
            "in the same order"
        )
        return None
    histograms = values[:, 1:]
    if features == "textons":
        sums, least = histograms.sum(axis=1), histograms.min(axis=1)
        reading.refuse(
            path, rows, (least < 0) | (np.abs(sums - 1) > SUM_TOLERANCE),
            lambda row: f"the histogram sums to {sums[row]:.4g} (smallest entry {least[row]:.4g}): "
            f"expected relative frequencies that sum to 1 within {SUM_TOLERANCE:.0%}, or "
            'features = "..." in the header for other features',
        )  # fmt: skip
    return histograms if reading.order is None else histograms[reading.order]
