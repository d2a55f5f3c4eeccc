"""``flight.toml``, the header of a Flight folder: its keys are declared in a table.

`read_header` reads it, with every fault as a sentence; a new key is a line in a table.
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from trexton.base.errors import FlightError, ParameterError
from trexton.base.files import read_text
from trexton.vision.rectification import Rectification

__all__ = ["FARTHEST", "FORMAT", "read_header"]

FORMAT = 1
SMALLEST_AREA = 1e-3  # metres
FARTHEST = 2e7  # metres: half way round the Earth


def _numbers(values: object, count: int) -> bool:
    """Whether they are a list of so many finite numbers."""
    if not isinstance(values, list) or len(values) != count:
        return False
    try:
        return all(type(value) in (int, float) and math.isfinite(value) for value in values)
    except OverflowError:  # a whole number beyond all floats
        return False


def _within(value: Any, most: float) -> bool:
    return _numbers([value], 1) and abs(value) <= most


def _range(value: Any) -> bool:
    frames = isinstance(value, list) and [type(number) for number in value] == [int, int]
    return frames and value[0] <= value[1]


def _invertible(rows: Any) -> bool:
    """Whether a homography can be inverted, whatever the scales of its columns and rows."""
    if not (isinstance(rows, list) and len(rows) == 3 and all(_numbers(row, 3) for row in rows)):
        return False
    matrix = np.array(rows, dtype=float)
    for axis in (0, 1):
        largest = np.abs(matrix).max(axis=axis, keepdims=True)
        if not (largest > 0).all():
            return False
        matrix = matrix / largest
    return bool(np.linalg.cond(matrix) < 1e10)


class _Key(NamedTuple):
    """A key of the header: what its value must be, in code and in words."""

    fits: Callable[[Any], bool]
    expected: str
    needed: bool = False


_TEXT = _Key(lambda value: isinstance(value, str), "text")
_PIXELS = _Key(lambda size: type(size) is int and size > 0, "positive numbers", True)
_SPLIT = _Key(_range, "[first frame, last frame]")
# By their tables; those of "" stand outside of any.
_KEYS: dict[str, dict[str, _Key]] = {
    "": {
        "format": _Key(lambda version: type(version) is int, "a whole number"),
        **dict.fromkeys(("name", "source", "licence", "features"), _TEXT),
        "notes": _Key(
            lambda value: isinstance(value, list) and all(map(_TEXT.fits, value)), "a list of texts"
        ),
        "area_m": _Key(
            lambda area: _numbers(area, 4) and area[0] < area[1] and area[2] < area[3],
            "[x_min, x_max, y_min, y_max] in metres",
        ),
    },
    "camera": {
        "width_px": _PIXELS,
        "height_px": _PIXELS,
        "focal_px": _Key(lambda f: _numbers([f], 1) and f > 0, "positive numbers", True),
        "center_px": _Key(lambda value: _numbers(value, 2), "[column, row] in pixels"),
    },
    "floor": {
        "image": _TEXT._replace(expected="a file name", needed=True),
        "world_from_pixel": _Key(
            _invertible,
            "three rows of three numbers that do not map the picture to a line or a point",
            True,
        ),
    },
    "origin": {
        "latitude_deg": _Key(lambda x: _within(x, 90), "degrees of latitude, -90 to 90", True),
        "longitude_deg": _Key(lambda x: _within(x, 180), "degrees of longitude, -180 to 180", True),
    },
    "rectification": {},  # read by `Rectification`
    "split": {},
}


def read_header(path: Path) -> tuple[dict[str, Any] | None, list[str]]:
    """The header, or None, and its faults as sentences that name the file."""
    try:
        if not path.exists():
            return None, [
                f"{path}: not found: a flight folder needs flight.toml with at least a name"
            ]
        header = tomllib.loads(read_text(path))
    except FlightError as error:
        return None, [str(error)]
    except (ValueError, RecursionError) as error:  # TOML's own, or a number of too many digits
        return None, [f"{path}: not valid TOML ({error}): correct it"]
    faults = [f"{path}: {fault}" for fault in _faults(header)]
    return (None if faults else header), faults


def _faults(header: dict[str, Any]) -> list[str]:
    known = sorted({*_KEYS[""], *_KEYS} - {""})
    if unknown := sorted(set(header) - set(known)):
        return [f"unknown key {unknown[0]!r}: the keys are {', '.join(known)}"]
    version = header.get("format", FORMAT)
    if not isinstance(version, int) or version > FORMAT:
        return [
            f"format {version} is newer than {FORMAT}, the newest this version reads: update "
            "trexton"
        ]
    faults: list[str] = []
    for name, keys in _KEYS.items():
        table = header.get(name) if name else header
        if table is None:
            continue
        if not isinstance(table, dict):
            faults.append(f"{name} is {table!r}: expected a table [{name}]")
            continue
        for key, declared in (dict.fromkeys(table, _SPLIT) if name == "split" else keys).items():
            what = f"[{name}] {key}" if name else key
            if key not in table:
                faults += [f"{what} is missing: give it, or drop the table"] * declared.needed
            elif not declared.fits(table[key]):
                faults.append(f"{what} is {table[key]!r}: expected {declared.expected}")
    if not faults and "area_m" in header:
        x_min, x_max, y_min, y_max = area = header["area_m"]
        if min(x_max - x_min, y_max - y_min) < SMALLEST_AREA or max(map(abs, area)) > FARTHEST:
            faults.append(
                f"area_m is {area}: sides of {x_max - x_min:g} m and {y_max - y_min:g} m are no "
                "place to fly in: give metres"
            )
    if not faults and "rectification" in header:
        try:
            Rectification.from_table(header["rectification"])
        except ParameterError as error:
            faults.append(f"[rectification]: {error}")
    return faults
