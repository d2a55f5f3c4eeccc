"""Positions that an autopilot logged: ArduPilot's ``.bin``, PX4's ``.ulg``, DJI's subtitles
(``.srt``) beside a video. `read_log`: metres east and north, yaw anticlockwise from north.
"""

import io
import re
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.files import read_text
from trexton.flights.importers.mocap import UNITS
from trexton.flights.importers.recording import (
    PoseTrack,
    local_metres,
    nanoseconds,
    printed,
    reading,
    together,
)

# Messages of ArduPilot that hold a position, the best first, or an attitude, and their parts.
_MESSAGES = {
    "POS": ("Lat", "Lng", "RelHomeAlt"),
    "GPS": ("Lat", "Lng", "RAlt"),
    **dict.fromkeys(("XKF1", "NKF1"), ("PE", "PN", "PD")),
    "ATT": ("Roll", "Pitch", "Yaw"),
}
_NUMBER = r"([-+]?\d+(?:[.,]\d+)?)"
# DJI's two ways; the first gives longitude before latitude.
_GPS = re.compile(rf"GPS\s*\({_NUMBER},\s*{_NUMBER}")
_AUTEL = re.compile(rf"GPS\s*\(([EW]):\s*{_NUMBER},\s*([NS]):\s*{_NUMBER}")
_PLACE = re.compile(rf"latitude\s*:\s*{_NUMBER}.*?longt?itude\s*:\s*{_NUMBER}", re.S)
_HEIGHT = re.compile(rf"(?:rel_alt\s*:|\bH|BAROMETER\s*:)\s*{_NUMBER}\s*(ft|feet)?")
_SKIPPED = re.compile(r"(?m)^(?:bad header|unknown msg|Skipped).*")
_CLOCK = re.compile(r"(\d{1,6}):(\d\d):(\d\d)[,.](\d{3})\s*-->")


def read_log(path: Path) -> tuple[PoseTrack, list[str]] | None:
    """The track in a log, and what to know of it; None where the suffix is of none. Raises
    `FlightError` where the log cannot be read, or holds no position.
    """
    if (read := _READERS.get(path.suffix.lower())) is None:
        return None
    with printed(_SKIPPED) as skipped, redirect_stdout(out := io.StringIO()), redirect_stderr(out):
        track = read(path)
    if track is None or not len(track.time_ns):
        raise FlightError(f"{path}: no position in it: is it a log, and was there a fix?")
    track, said = track.ordered(str(path))
    if skipped := skipped + _SKIPPED.findall(out.getvalue()):  # every byte of it
        said.append(f"{path}: damaged, parts were passed over (first: {skipped[0]})")
    return track, said


def _earthly(rows: np.ndarray, attitude: np.ndarray | None = None) -> PoseTrack | None:
    """From rows of seconds, latitude, longitude and height; those at 0, 0 had no fix."""
    fixed = np.abs(rows[:, 1:3]).max(axis=1, initial=0) > 1e-6
    if not fixed.any():
        return None
    fixed[fixed] = together(rows[fixed, 1:3])  # before a fix, some tell where they were last
    metres, origin = local_metres(*rows[fixed, 1:3].T)
    turned = None if attitude is None else attitude[fixed]
    stamps = nanoseconds(rows[fixed, 0])
    return PoseTrack(stamps, np.column_stack([metres, rows[fixed, 3]]), turned, origin)


def _subtitles(path: Path) -> PoseTrack | None:
    rows = []
    parts = _CLOCK.split(read_text(path))
    for at in range(1, len(parts), 5):
        hours, minutes, seconds, milli = map(int, parts[at : at + 4])
        block = parts[at + 4]
        if (found := _PLACE.search(block)) is not None:
            place = found.groups()
        elif (found := _GPS.search(block)) is not None:
            place = found.groups()[::-1]
        elif (found := _AUTEL.search(block)) is not None:
            east, longitude, north, latitude = found.groups()
            place = "-" * (north == "S") + latitude, "-" * (east == "W") + longitude
        else:
            continue
        height = _HEIGHT.search(block)
        values = [each.replace(",", ".") for each in (*place, height[1] if height else "nan")]
        rows.append([3600 * hours + 60 * minutes + seconds + milli / 1000, *map(float, values)])
        rows[-1][3] *= UNITS["ft"] if height and height[2] else 1
    return _earthly(np.array(rows, dtype=float).reshape(-1, 4))


def _messages(path: Path) -> Iterator[tuple[str, list[float]]]:
    """Kind, seconds and values of each message of the first instance in a log of ArduPilot."""
    with reading(path, "log", "copy it again"):
        from pymavlink.DFReader import DFReader_binary

        class Log(DFReader_binary):  # type: ignore[misc]
            def recv_msg(self) -> Any:
                before, message = self.offset, super().recv_msg()
                if message is not None and self.offset <= before:  # it would come for ever
                    raise ValueError(f"the message at byte {before} has no length")
                return message

        log = Log(str(path))
        while (message := log.recv_match(type=list(_MESSAGES))) is not None:
            kind = message.get_type()
            if getattr(message, "C", 0) == 0 and getattr(message, "I", 0) == 0:
                values = [float(getattr(message, name, np.nan)) for name in _MESSAGES[kind]]
                yield kind, [message._timestamp, *values]


def _ardupilot(path: Path) -> PoseTrack | None:
    with path.open("rb") as file:
        if file.read(2) != b"\xa3\x95":  # its reader tells of every byte that it skips
            raise FlightError(f"{path}: no log of ArduPilot: of COLMAP, export the model as text")
    rows: dict[str, list[list[float]]] = {}
    for kind, row in _messages(path):
        rows.setdefault(kind, []).append(row)
    angled = np.array(rows.pop("ATT", []))
    if not (kind := next((each for each in _MESSAGES if each in rows), "")):
        return None
    table, attitude = np.array(rows[kind]), None
    if len(angled):
        angles = np.unwrap(np.radians(angled[:, 1:]), axis=0) * (1, 1, -1)
        attitude = _at(table[:, 0], angled[:, 0], angles)
    if "Lat" in _MESSAGES[kind]:
        return _earthly(table, attitude)
    stamps = nanoseconds(table[:, 0])
    return PoseTrack(stamps, table[:, 1:] * (1, 1, -1), attitude)


class _Finite(io.BufferedReader):
    """A file that a reader who goes back in it may not read for ever."""

    def __init__(self, path: Path):
        super().__init__(io.FileIO(path))
        self._left = 1000 + 16 * path.stat().st_size  # reads: a message takes two

    def read(self, size: int | None = -1, /) -> bytes:
        self._left -= 1
        if self._left < 0:
            raise OSError("it leads back into itself")
        return super().read(size)


def _px4(path: Path) -> PoseTrack | None:
    with reading(path, "log", "copy it again"):
        from pyulog import ULog

        log = ULog(_Finite(path), ["vehicle_local_position", "vehicle_attitude"])
        logged: dict[str, Any] = {each.name: each.data for each in reversed(log.data_list)}
        if not (data := logged.get("vehicle_local_position")):
            return None
        good = np.asarray(data["xy_valid"], dtype=bool)
        stamps = np.asarray(data["timestamp"], dtype=np.int64)[good]
        heading = np.asarray(data.get("heading", data.get("yaw")), dtype=float)[good]
        north, east, down, latitude, longitude = (
            np.asarray(data[name], dtype=float)[good]
            for name in ("x", "y", "z", "ref_lat", "ref_lon")
        )
        tilt = _px4_tilt(stamps, logged.get("vehicle_attitude", {}))
    place, origin = np.column_stack([east, north, -down]), None
    if len(known := np.flatnonzero(np.isfinite(latitude + longitude) & (latitude != 0))):
        degrees = (np.interp(stamps, stamps[known], each[known]) for each in (latitude, longitude))
        moved, origin = local_metres(*degrees)  # the reference may be set anew in flight
        place[:, :2] += moved
    return PoseTrack(stamps * 1000, place, np.column_stack([tilt, -heading]), origin)


def _px4_tilt(stamps: np.ndarray, data: dict[str, Any]) -> np.ndarray:
    """``(N, 2)`` roll and pitch at microseconds; NaN where none was logged."""
    from scipy.spatial.transform import Rotation

    turns = np.column_stack([data.get(f"q[{part}]", [0.0]) for part in (1, 2, 3, 0)])
    if not (known := turns.any(axis=1)).any():
        return np.full((len(stamps), 2), np.nan)
    angles = Rotation.from_quat(turns[known]).as_euler("ZYX")[:, :0:-1]
    return _at(stamps, data["timestamp"][known], np.unwrap(angles, axis=0))


def _at(stamps: np.ndarray, time: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """``(N, K)`` angles at the stamps, of ``(M, K)`` that are counted on."""
    return np.column_stack([np.interp(stamps, time, each) for each in angles.T])


_READERS = {".bin": _ardupilot, ".srt": _subtitles, ".ulg": _px4}
