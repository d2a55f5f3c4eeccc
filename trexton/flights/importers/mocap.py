"""Exports of motion capture: Motive (OptiTrack), Vicon Tracker and Nexus, Qualisys Track Manager.

`read_motion_capture` finds out which wrote a file and gives the columns of one rigid body as a
table, with what they mean as options of `TrackColumns`.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from trexton.base.errors import FlightError
from trexton.flights.tables import LENGTHS, TextTable, read_text

__all__ = ["read_motion_capture"]

_UNITS = {"meters": "m", "metres": "m", "centimeters": "cm", "millimeters": "mm"}
_NUMBER = re.compile(r"[-+]?\d+(\.\d*)?")
_VICON = ("objects", "segments", "model outputs", "trajectories")

Row = list[str]


@dataclass(frozen=True)
class _Export:
    """What an export says: where its columns are, by body, and how they are read.

    Attributes
    ----------
    bodies : dict of str to dict of str to int
        For each rigid body the places of its columns.
    first : int
        The row where numbers begin, from 0.
    settings : dict of str to str
        Of `TrackColumns`.
    rate : float
        Frames a second, where there is no column of stamps.
    said : str
    """

    bodies: dict[str, dict[str, int]]
    first: int
    settings: dict[str, str]
    rate: float = 0.0
    said: str = ""


def read_motion_capture(
    path: Path, body: str
) -> tuple[TextTable, dict[str, str], list[str]] | None:
    """The table of one body, how it is read, and what to know; None where the file is no export.

    Parameters
    ----------
    body : str
        Its name; empty where there is only one.

    Raises
    ------
    FlightError
        It has no such body, or several and none is named.
    """
    if path.suffix.lower() not in (".csv", ".tsv", ".txt"):
        return None
    text = read_text(path)
    begin = text[:200].lower()
    read: Callable[[list[Row]], _Export]
    if begin.startswith("format version"):
        read = _motive
    elif begin.startswith(("no_of_frames", "file_version")):
        read = _qualisys
    elif begin.splitlines()[:1] and begin.splitlines()[0].strip(' ",') in _VICON:
        read = _vicon
    else:
        return None
    lines = text.splitlines()
    try:
        rows = list(csv.reader(lines, delimiter="\t" if read is _qualisys else ","))
        export = read(rows)
    except (LookupError, ValueError, StopIteration, csv.Error) as error:
        raise FlightError(
            f"{path}: begins as an export of motion capture, but its head cannot be read "
            f"({error}): export rigid bodies with their header"
        ) from None
    names = [name for name in export.bodies if body in ("", name)]
    if len(names) != 1:
        raise FlightError(
            f"{path}: rigid bodies {', '.join(export.bodies) or 'none'}: name one with --body"
        )
    places = export.bodies[names[0]]
    kept: list[int] = []
    cells: list[Row] = []
    for number, row in enumerate(rows[export.first :], export.first):
        if not (row and _NUMBER.fullmatch(row[0].strip())):
            if kept:
                break  # another table follows
        elif len(row) > max(places.values()):
            kept.append(number + 1)
            cells.append([row[place].strip() for place in places.values()])
    if not kept:
        raise FlightError(f"{path}: no rows of {names[0]}: export it anew")
    columns = dict(zip(places, map(tuple, zip(*cells, strict=True)), strict=True))
    if export.rate:
        frames = [float(frame) for frame in columns.get("frame", range(len(kept)))]
        columns["time"] = tuple(f"{(each - frames[0]) / export.rate:.9f}" for each in frames)
    table = TextTable(path, list(columns), columns, kept, ",", ".")
    return table, export.settings, [f"{path}: body {names[0]}{export.said}"]


def _motive(rows: list[Row]) -> _Export:
    """Kinds, names, ids, then Rotation and Position, then X, Y, Z, W: a row each. y is up."""
    head = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    at = next(number for number, row in enumerate(rows) if row and row[0].strip() == "Frame")
    above = [row for row in rows[1:at] if any(cell.strip() for cell in row)]
    kinds, names, parts = above[0], above[1], above[-1]
    bodies: dict[str, dict[str, int]] = {}
    for place in range(2, min(map(len, (kinds, names, parts, rows[at])))):
        axis = rows[at][place].strip()
        if kinds[place].strip() != "Rigid Body" or parts[place] not in ("Position", "Rotation"):
            continue
        columns = bodies.setdefault(names[place], {"time": 1})
        columns[axis if parts[place] == "Position" else f"R{axis}"] = place
    settings = {"time": "time", "x": "X", "y": "-Z", "z": "Y"}
    said = ", y up (Motive's default): x, -z, y are x, y, z unless others are named"
    if head.get("Rotation Type", "Quaternion") == "Quaternion":
        settings["quaternion"] = "RX,-RZ,RY,RW"
    else:
        said += "; its angles are left out, export quaternions"
    settings["unit"] = _UNITS[head.get("Length Units", "Meters").lower()]
    for columns in bodies.values():  # as the file calls it, for who names columns
        columns[rows[at][1].strip()] = 1
    return _Export(bodies, at + 1, settings, said=said)


def _vicon(rows: list[Row]) -> _Export:
    """Rate, names over their first column, axes, units: a row each."""
    rate, names, axes, units = float(rows[1][0]), rows[2], rows[3], rows[4]
    bodies: dict[str, dict[str, int]] = {}
    name = ""
    for place in range(2, len(axes)):
        if place < len(names) and names[place].strip():
            name = names[place].strip().removeprefix("Global Angle").strip().rpartition(":")[2]
        axis = axes[place].strip()
        if axis and "'" not in axis:  # no velocities
            bodies.setdefault(name, {"frame": 0})[axis] = place
    known = next(iter(bodies.values()))
    letter = "T" if "TX" in known else ""
    settings = {"time": "time", "x": f"{letter}X", "y": f"{letter}Y", "z": f"{letter}Z"}
    said = f", {rate:g} frames a second"
    if "RW" in known:
        settings["quaternion"] = "RX,RY,RZ,RW"
    elif "RX" in known:
        said += "; its angles are left out, export quaternions"
    settings["unit"] = units[known[settings["x"]]].strip()
    if settings["unit"] not in LENGTHS:
        raise ValueError(f"unit {settings['unit']!r}")
    return _Export(bodies, 5, settings, rate, said)


def _qualisys(rows: list[Row]) -> _Export:
    """Keys with values, then columns: of 6D x, y, z, angles, residual, nine of a matrix."""
    keys = {
        row[0].strip(): [cell.strip() for cell in row[1:] if cell.strip()]
        for row in rows[:20]
        if row
    }
    at = next(
        number
        for number, row in enumerate(rows)
        if len(row) > 2 and any(re.fullmatch(r"(.* )?X", cell.strip()) for cell in row)
    )
    axes = [cell.strip() for cell in rows[at]]
    bodies: dict[str, dict[str, int]] = {}
    timed = {"time": axes.index("Time")} if "Time" in axes else {}
    named = iter(keys.get("BODY_NAMES") or keys.get("MARKER_NAMES") or [])
    name = ""
    for place, axis in enumerate(axes):
        body, _, axis = axis.rpartition(" ")
        if axis == "X":
            name = body or next(named)
        if name and axis in ("X", "Y", "Z") or axis.startswith("Rot["):
            bodies.setdefault(name, dict(timed))[axis.lower()] = place
    known = next(iter(bodies.values()))
    settings = {"time": "time", "x": "x", "y": "y", "z": "z", "unit": "mm"}
    matrix = [f"rot[{number}]" for number in range(9)]
    if set(matrix) <= set(known):
        settings["quaternion"] = ",".join(matrix)
    rate = 0.0 if timed else float(keys["FREQUENCY"][0])
    if rate and "Frame" in axes:
        for columns in bodies.values():
            columns["frame"] = axes.index("Frame")
    return _Export(bodies, at + 1, settings, rate, ", millimetres")
