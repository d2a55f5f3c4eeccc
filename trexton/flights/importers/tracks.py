"""Files of positions: `TrackColumns` declares a table; `read_track` also finds out trajectories of
TUM, motion capture, logs and subtitles; `read_reconstruction` is for COLMAP's and OpenSfM's.
"""

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.files import read_text
from trexton.base.options import Options, option
from trexton.flights.importers.autopilot import read_log
from trexton.flights.importers.axes import (
    AXES,
    MAX_ANGLE,
    attitude_from_quaternions,
    axes_option,
    camera_attitude,
)
from trexton.flights.importers.mocap import UNITS, read_mocap
from trexton.flights.importers.recording import PoseTrack
from trexton.flights.tables import TIMES, TextTable, is_number, read_table


@dataclass(frozen=True)
class TrackColumns(Options):
    """Columns of a table of positions, and their units; a minus before a name turns its sign."""

    time: str = option("t", "column of the stamps")
    x: str = option("x", "column of x")
    y: str = option("y", "column of y")
    z: str = option("", "column of the height above the floor")
    yaw: str = option("", "column of the yaw: anticlockwise, 0 where the picture's top is +y")
    quaternion: str = option("", "columns of the attitude instead of a yaw, as in qx,qy,qz,qw")
    axes: str = axes_option()
    time_unit: str = option("s", "unit of the stamps", choices=tuple(TIMES))
    unit: str = option("m", "unit of the positions", choices=tuple(UNITS))
    degrees: bool = option(False, "the yaw is in degrees")
    body: str = option("", "of motion capture: the rigid body (default: the only one)")

    def of(self, table: TextTable, stamps: np.ndarray | None = None) -> tuple[PoseTrack, list[str]]:
        """The track in order of its stamps, and what to know of it; `stamps` are ``(N,)`` int64
        nanoseconds, where no column has them. Raises `FlightError` where a column is missing, or
        holds something else.
        """
        if self.body:
            raise FlightError(f"{table.path}: no export of motion capture that is known: drop body")
        said: list[str] = []
        if stamps is None:
            stamps = self.stamps(table, said)
        names = (self.x, self.y, self.z)
        position = np.column_stack([metres(table, name, self.unit, said) for name in names])
        track, where, lines = PoseTrack(stamps, position), str(table.path), table.rows
        if parts := [name.strip() for name in self.quaternion.split(",") if name.strip()]:
            if sorted(name[-1].lower() for name in parts) == list("wxyz") and "-" not in parts[1]:
                parts.sort(key=lambda name: "xyzw".index(name[-1].lower()))  # as they are called
            if [re.sub(r"\D", "", name) for name in parts] == list("0123"):  # as in logs of PX4
                said.append(f"{where}: {parts[0]}, number 0 of the quaternion, is taken as w")
                parts = parts[1:] + parts[:1]
            if len(parts) not in (4, 9):
                raise FlightError(f"{where}: quaternion names {len(parts)} columns: expected four")
            turns = np.column_stack([_column(table, name) for name in parts])
            if len(parts) == 9:
                turns = _quaternions(turns)
            track, more = pose_track(track, turns, self.axes, where, lines)
            return track, said + more
        if self.yaw:
            yaw = _column(table, self.yaw)
            largest = float(np.nanmax(np.abs(yaw), initial=0))
            degrees = self.degrees or re.search(r"(?i)deg(rees)?\W?$", self.yaw) is not None
            found = f"{where}: yaw of up to {largest:.4g}"
            if not degrees and largest > MAX_ANGLE:
                said.append(f"{found}, beyond two turns in radians: degrees? give --degrees")
            wraps = np.abs(np.abs(np.diff(yaw)) - 2 * np.pi) < 0.2
            if degrees and largest < 6.3 and wraps.any():
                said.append(f"{found} wraps: radians? leave --degrees out")
            if re.match(r"(?i)heading|course|azimuth|compass", self.yaw):
                said.append(f"{found} taken as anticlockwise: of a compass? give --yaw=-{self.yaw}")
            yaw = np.radians(yaw) if degrees else yaw
            track = replace(track, attitude=np.column_stack([np.full((len(yaw), 2), np.nan), yaw]))
        track, order = track.ordered(where, lines)
        return track, said + order

    def stamps(self, table: TextTable, said: list[str]) -> np.ndarray:
        """``(N,) int64`` nanoseconds, which count on over midnight."""
        unit = _unit(table, self.time, self.time_unit, TIMES, said)
        return next_day(table.nanoseconds(self.time, unit), table.path, table.rows, said)


def metres(table: TextTable, name: str, unit: str, said: list[str]) -> np.ndarray:
    """``(N,)`` metres; unless a unit is given, of that with which the column's name ends."""
    if not name:
        return np.full(len(table), np.nan)
    return UNITS[_unit(table, name, unit, UNITS, said)] * _column(table, name)


def _unit(table: TextTable, name: str, unit: str, units: Iterable[str], said: list[str]) -> str:
    """The unit, if another than the usual first is given; else that with which a name ends; ``in``
    and ``d`` count in brackets only.
    """
    usual, *others = units
    ending = re.search(rf"(?i)[_ (\[]({'|'.join(others)}|feet)[)\]]?(?<![_ ]in)(?<![_ ]d)$", name)
    if ending is None or unit != usual:
        return unit
    said.append(f"{table.path}: {name} is taken in {ending[1].lower()}, as its name says")
    return ending[1].lower().replace("feet", "ft")


def next_day(stamps: np.ndarray, path: Path, rows: Sequence[int], said: list[str]) -> np.ndarray:
    """``(N,) int64`` stamps: times of day alone that begin anew are counted on, which is `said`."""
    anew = np.diff(stamps, prepend=stamps[:1]) < -23 * (TIMES["d"] // 24)
    if not anew.any() or stamps.min() < 0 or stamps.max() >= TIMES["d"]:
        return stamps
    row = rows[int(anew.argmax())]
    said.append(f"{path}, row {row}: times of day begin anew: counted on by 24 hours")
    return stamps + TIMES["d"] * np.cumsum(anew)


# Of COLMAP two lines an image: id, quaternion w, x, y, z, translation, camera, name; then points.
_COLMAP = r"(?:#.*\n|\s)*+\d+(?:\s+[-+.e\d]+){7}\s+\d+\s+\S*[A-Za-z]"
TUM = TrackColumns("stamp", "x", "y", "z", quaternion="qx,qy,qz,qw")


def pose_track(
    track: PoseTrack, turns: np.ndarray, axes: str, where: str, lines: Sequence[int]
) -> tuple[PoseTrack, list[str]]:
    """The track with the attitudes of its quaternions, in order of its stamps, and what to know.

    Rows whose quaternion is zero, as motion capture writes them that has lost its body, are
    dropped; where all are, only the attitude is not known.
    """
    lost, said = np.logical_not(turns.any(axis=1)), []
    if lost.all():
        return track.ordered(where, lines)
    if lost.any():
        first = lines[int(lost.argmax())]
        said = [f"{where}: {lost.sum()} rows without an attitude, left out (first: row {first})"]
        track, turns = track.rows(~lost), turns[~lost]
        lines = [lines[row] for row in np.flatnonzero(~lost).tolist()]
    attitude, taken = camera_attitude(turns, axes)
    track, order = replace(track, attitude=attitude).ordered(where, lines)
    return track, said + order + taken


def read_track(path: Path, columns: TrackColumns) -> tuple[PoseTrack, list[str]]:
    """The track in a file of any format that is known, and what to know of it; raises `FlightError`
    where it cannot be read as what it begins as.

    `columns` are of a table. Those of motion capture have names of their own, taken unless others
    than the defaults are asked for.
    """
    if (log := read_log(path)) is not None:
        return log
    if (captured := read_mocap(path, columns.body)) is not None:
        table, names, said = captured
        usual = TrackColumns().as_dict()
        asked = {key: given for key in usual if (given := getattr(columns, key)) != usual[key]}
        track, more = TrackColumns(**{**names, **asked, "body": ""}).of(table)
        return track, said + more
    fields = _first_fields(path)
    if len(fields) in (8, 9) and all(map(is_number, fields)):  # as TUM writes it, with blanks
        turn = columns.quaternion or TUM.quaternion
        columns = replace(columns, time="stamp", z="z", quaternion=turn)
        return columns.of(trajectory(path, turn))
    return columns.of(read_table(path))


def trajectory(path: Path, quaternion: str) -> TextTable:
    """A trajectory as TUM writes it, or UZH-FPV, which numbers its rows."""
    numbered = ["id"] if len(_first_fields(path)) == 9 else []
    return read_table(path, [*numbered, "stamp", "x", "y", "z", *quaternion.split(",")])


def _first_fields(path: Path) -> list[str]:
    lines = (line for line in read_text(path).splitlines() if line.strip())
    return next((line.split() for line in lines if not line.startswith("#")), [])


def _column(table: TextTable, name: str) -> np.ndarray:
    turned = name.startswith("-") and name not in table.header
    return -table.numbers(name[1:]) if turned else table.numbers(name)


def _quaternions(matrices: np.ndarray) -> np.ndarray:
    """x, y, z, w of ``(N, 9)`` rotations, column after column; zero where one is none."""
    from scipy.spatial.transform import Rotation

    turns = matrices.reshape(-1, 3, 3).transpose(0, 2, 1)
    good = np.isclose(np.linalg.det(np.nan_to_num(turns)), 1, atol=1e-2)
    result = np.where(np.isnan(matrices).any(axis=1)[:, None], np.nan, np.zeros((len(turns), 4)))
    result[good] = Rotation.from_matrix(turns[good]).as_quat()
    return result


def read_reconstruction(path: Path) -> tuple[list[str], PoseTrack, list[str]] | None:
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
            origin = origin if origin != (0, 0) else None  # without GPS
        elif re.match(_COLMAP, text):
            lines = [line.split(maxsplit=9) for line in text.splitlines() if line[:1] != "#"]
            rows = [row for row in lines if row and not is_number(row[-1].split()[-1])]
            turns = [[float(row[place]) for place in (2, 3, 4, 1)] for row in rows]
            names, shifts = [row[9].strip() for row in rows], [row[5:8] for row in rows]
        else:
            return None
        # Both tell how the world is turned and moved to the camera (right, down, ahead).
        to_world = Rotation.from_quat(np.array(turns, dtype=float)).inv()
        centres = -to_world.apply(np.array(shifts, dtype=float))
        centres[:, 2] += place.get("altitude", 0.0) if origin else 0.0
    except (AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
        raise FlightError(
            f"{path}: no reconstruction of COLMAP or OpenSfM that can be read ({error})"
        ) from None
    attitude = attitude_from_quaternions(to_world.as_quat(), AXES["camera"])
    scale = "" if origin else "; its unit and axes are its own, unless it was aligned"
    said = [f"{path}: {len(names)} poses of a reconstruction{several}{scale}"]
    return names, PoseTrack(np.zeros(len(names), np.int64), centres, attitude, origin), said
