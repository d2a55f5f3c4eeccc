"""Exports of motion capture: Motive (OptiTrack), Vicon Tracker and Nexus, Qualisys Track Manager.
`read_mocap` gives the columns of one rigid body as a table, and options of `TrackColumns`.
"""

import csv
import re
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from trexton.base.errors import FlightError
from trexton.base.files import read_text
from trexton.flights.tables import LENGTHS, TextTable

UNITS = {**LENGTHS, "ft": 0.3048, "in": 0.0254}  # metres
_WORDS = {"metres": "m", "meters": "m", "centimeters": "cm", "millimeters": "mm", "feet": "ft"}
_NUMBER = re.compile(r"[-+]?\d+([.,]\d*)?")

# Tables of Vicon's that hold positions, the best first.
_VICON = ("objects", "segments", "trajectories", "model outputs")

Row = list[str]


class _Export(NamedTuple):
    """What an export says: where its columns are, by body, and how they are read.

    `first` is the row where numbers begin, from 0; `settings` are those of `TrackColumns`; `rate`
    the frames a second, where there is no column of stamps.
    """

    bodies: dict[str, dict[str, int]]
    first: int
    settings: dict[str, str]
    said: str
    rate: float = 0.0


def read_mocap(path: Path, body: str) -> tuple[TextTable, dict[str, str], list[str]] | None:
    """The table of one body, how it is read, and what to know; None where the file is no export.
    `body` may be empty where there is only one; raises `FlightError` where there is no such, or
    several and none is named.
    """
    if path.suffix.lower() not in (".csv", ".tsv", ".txt"):
        return None
    lines = read_text(path).splitlines() or [""]
    separator = max(",;\t", key="\n".join(lines[:10]).count)
    begin = [cell.strip(' "').lower() for cell in lines[0].split(separator)]
    read = _FORMATS.get(begin[0])
    if read is None or read is _vicon and any(begin[1:]):
        return None
    try:
        rows = list(csv.reader(lines, delimiter=separator))
        export = read(rows)
    except (LookupError, ValueError, StopIteration, csv.Error) as error:
        head = f"its head cannot be read ({str(error) or 'no row names columns'})"
        found = f"begins as an export of motion capture, but {head}"
        raise FlightError(f"{path}: {found}: export rigid bodies with their header") from None
    names = [name for name in export.bodies if body in ("", name)]
    if len(names) != 1:
        bodies = ", ".join(export.bodies) or "none"
        raise FlightError(f"{path}: rigid bodies {bodies}: name one with --body")
    places = export.bodies[names[0]]
    kept: list[int] = []
    for number, row in enumerate(rows[export.first :], export.first):
        if not (row and _NUMBER.fullmatch(row[0].strip())):
            if kept:
                break  # another table follows
        elif len(row) > max(places.values()):
            kept.append(number)
    if not kept:
        raise FlightError(f"{path}: no rows of {names[0]}: export it anew")
    columns = {name: [rows[row][place] for row in kept] for name, place in places.items()}
    if export.rate:
        frames = [float(frame) for frame in columns.get("frame", range(len(kept)))]
        columns["time"] = [f"{(each - frames[0]) / export.rate:.9f}" for each in frames]
    comma = separator != "," and any("," in cell for cells in columns.values() for cell in cells)
    table = TextTable(path, columns, [row + 1 for row in kept], "," if comma else ".")
    return table, export.settings, [f"{path}: body {names[0]}{export.said}"]


def _motive(rows: list[Row]) -> _Export:
    """Kinds, names, ids, then Rotation and Position, then X, Y, Z, W: a row each. y is up."""
    head = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    at = next(number for number, row in enumerate(rows) if row and row[0].strip() == "Frame")
    above = [row for row in rows[1:at] if any(cell.strip() for cell in row)]
    kinds, names, parts, axes = above[0], above[1], above[-1], rows[at]
    bodies: dict[str, dict[str, int]] = {}
    for place, (kind, name, part, axis) in enumerate(zip(kinds, names, parts, axes, strict=False)):
        if place > 1 and kind.strip() == "Rigid Body" and part in ("Position", "Rotation"):
            # The stamps also as the file calls them, for who names columns.
            columns = bodies.setdefault(name, {"time": 1, axes[1].strip(): 1})
            columns[axis.strip() if part == "Position" else f"R{axis.strip()}"] = place
    settings = {"time": "time", "x": "X", "y": "-Z", "z": "Y"}
    settings["unit"] = _WORDS[head.get("Length Units", "Meters").lower()]
    said = ", y up (Motive's default): x, -z, y are x, y, z unless others are named"
    if head.get("Rotation Type", "Quaternion") == "Quaternion":
        settings["quaternion"] = "RX,-RZ,RY,RW"
    else:
        said += "; its angles are left out, export quaternions"
    return _Export(bodies, at + 1, settings, said)


def _vicon(rows: list[Row]) -> _Export:
    """Rate, names over their first column, axes, units: a row each, in each of several tables."""
    begins = {row[0].lower(): n for n, row in enumerate(rows) if row and not any(row[1:])}
    begin = next(begins[kind] for kind in _VICON if kind in begins)
    (rate, *_), names, axes, units = rows[begin + 1 : begin + 5]
    bodies: dict[str, dict[str, int]] = {}
    name = ""
    for place in range(2, len(axes)):
        if place < len(names) and names[place].strip():
            whole = names[place].strip().removeprefix("Global Angle").strip()
            name = whole.rpartition(":")[2]
            name = whole if name in bodies else name  # of another subject
        axis = axes[place].strip()
        if axis and "'" not in axis:  # no velocities
            bodies.setdefault(name, {"frame": 0})[axis] = place
    known = next(iter(bodies.values()))
    letter = "T" if "TX" in known else ""
    settings = {"time": "time", "x": f"{letter}X", "y": f"{letter}Y", "z": f"{letter}Z"}
    settings["unit"] = units[known[settings["x"]]].strip()
    if settings["unit"] not in UNITS:
        raise ValueError(f"unit {settings['unit']!r}")
    said = f", {rate} frames a second"
    if "RW" in known:
        settings["quaternion"] = "RX,RY,RZ,RW"
    elif "RX" in known:
        said += "; its angles are left out, export quaternions"
    return _Export(bodies, begin + 5, settings, said, float(rate))


def _qualisys(rows: list[Row]) -> _Export:
    """Keys with values, then columns: of 6D x, y, z, angles, residual, nine of a matrix."""
    head = [[cell.strip() for cell in row] for row in rows[:20]]
    keys = {row[0]: list(filter(None, row[1:])) for row in head if row}
    at, axes = next(
        (number, [cell.strip() for cell in row])
        for number, row in enumerate(rows)
        if len(row) > 2 and any(re.fullmatch(r"(.* )?X", cell.strip()) for cell in row)
    )
    timed = {name.lower(): axes.index(name) for name in ("Frame", "Time") if name in axes}
    bodies: dict[str, dict[str, int]] = {}
    named = iter(keys.get("BODY_NAMES") or keys.get("MARKER_NAMES") or [])
    name = ""
    for place, axis in enumerate(axes):
        body, _, axis = axis.rpartition(" ")
        if axis == "X":
            name = body or next(named)
        if name and axis in ("X", "Y", "Z") or axis.startswith("Rot["):
            bodies.setdefault(name, dict(timed))[axis.lower()] = place
    settings = {"time": "time", "x": "x", "y": "y", "z": "z", "unit": "mm"}
    matrix = [f"rot[{number}]" for number in range(9)]
    if set(matrix) <= set(next(iter(bodies.values()))):
        settings["quaternion"] = ",".join(matrix)
    rate = 0.0 if "time" in timed else float(keys["FREQUENCY"][0])
    return _Export(bodies, at + 1, settings, ", millimetres", rate)


# By what the first cell says.
_FORMATS: dict[str, Callable[[list[Row]], _Export]] = {
    "format version": _motive,
    **dict.fromkeys(("no_of_frames", "file_version"), _qualisys),
    **dict.fromkeys(("devices", *_VICON), _vicon),
}
