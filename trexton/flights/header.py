"""``flight.toml``, the header of a Flight folder: its keys are declared in a table.

`read_header` reads it, with every fault as a sentence; a new key is a line in a table.
"""

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import FlightError, ParameterError
from trexton.base.files import read_toml
from trexton.vision.camera import Rectification

FORMAT = 1
SMALLEST_AREA = 1e-3  # metres
FARTHEST = 2e7  # metres: half way round the Earth


def _text(value: Any) -> bool:
    return isinstance(value, str)


def _numbers(values: Any, count: int) -> bool:
    """Whether they are a list of so many finite numbers."""
    try:
        return len(values) == count and all(
            type(value) in (int, float) and math.isfinite(value) for value in values
        )
    except (OverflowError, TypeError):  # a whole number beyond all floats, or no list
        return False


def _frames(value: Any) -> bool:
    return _numbers(value, 2) and type(value[0]) is type(value[1]) is int and value[0] <= value[1]


def _invertible(rows: Any) -> bool:
    if not (isinstance(rows, list) and len(rows) == 3 and all(_numbers(row, 3) for row in rows)):
        return False
    matrix = np.array(rows, dtype=float)
    for axis in (0, 1):  # whatever the scales: pixels of millimetres, thousands of kilometres away
        largest = np.abs(matrix).max(axis=axis, keepdims=True)
        if not largest.all():
            return False
        matrix = matrix / largest
    return bool(np.linalg.cond(matrix) < 1e10)


# By their tables, those of "" stand outside of any: what a value must be, in code and in words.
_KEYS: dict[str, dict[str, tuple[Callable[[Any], bool], str]]] = {
    "": {
        "format": (lambda version: type(version) is int, "a whole number"),
        "name": (lambda value: _text(value) and "\n" not in value, "text of one line"),
        **dict.fromkeys(("source", "licence", "features"), (_text, "text")),
        "notes": (lambda value: type(value) is list and all(map(_text, value)), "a list of texts"),
        "area_m": (
            lambda area: _numbers(area, 4) and area[0] < area[1] and area[2] < area[3],
            "[x_min, x_max, y_min, y_max] in metres",
        ),
    },
    "camera": {
        "width_px": (lambda size: type(size) is int and size > 0, "positive numbers"),
        "height_px": (lambda size: type(size) is int and size > 0, "positive numbers"),
        "focal_px": (lambda value: _numbers([value], 1) and value > 0, "positive numbers"),
        "center_px": (lambda value: _numbers(value, 2), "[column, row] in pixels"),
    },
    "floor": {
        "image": (_text, "a file name"),
        "world_from_pixel": (
            _invertible,
            "three rows of three numbers that do not map the picture to a line or a point",
        ),
    },
    "origin": {
        "latitude_deg": (
            lambda x: _numbers([x], 1) and abs(x) <= 90, "degrees of latitude, -90 to 90"
        ),
        "longitude_deg": (
            lambda x: _numbers([x], 1) and abs(x) <= 180, "degrees of longitude, -180 to 180"
        ),
    },
    "rectification": {},  # read by `Rectification`
    "split": {},  # names of a person's own
}  # fmt: skip
_FREE = {"center_px", *_KEYS[""]}  # may be left out


def read_header(path: Path) -> tuple[dict[str, Any] | None, list[str]]:
    """The header, or None, and its faults as sentences that name the file."""
    if not path.exists():
        return None, [f"{path}: not found: a flight folder needs flight.toml with at least a name"]
    try:
        header = read_toml(path)
    except FlightError as error:
        return None, [str(error)]
    faults = [f"{path}: {fault}" for fault in _faults(header)]
    return (None if faults else header), faults


def _faults(header: dict[str, Any]) -> list[str]:
    known = sorted({*_KEYS[""], *_KEYS} - {""})
    if unknown := sorted(set(header) - set(known)):
        return [f"unknown key {unknown[0]!r}: the keys are {', '.join(known)}"]
    version = header.get("format", FORMAT)
    if isinstance(version, int) and version > FORMAT:
        return [f"format {version} is newer than {FORMAT}: update trexton"]
    return list(_wrong_entries(header)) or list(_wrong_as_a_whole(header))


def _wrong_entries(header: dict[str, Any]) -> Iterator[str]:
    for name, keys in _KEYS.items():
        table = header.get(name, {}) if name else header
        if not isinstance(table, dict):
            yield f"{name} is {table!r}: expected a table [{name}]"
            continue
        if name == "split":
            odd = [key for key in table if key != key.lower() in ("train", "test")]
            yield from (f"[split] {key} is read by nobody: name it {key.lower()}" for key in odd)
            keys = dict.fromkeys(table, (_frames, "[first frame, last frame]"))
        for key, (fits, expected) in keys.items():
            what = f"[{name}] {key}" if name else key
            if key in table and not fits(table[key]):
                yield f"{what} is {table[key]!r}: expected {expected}"
            elif key not in table and name in header and key not in _FREE:
                yield f"{what} is missing: give it, or drop the table"


def _wrong_as_a_whole(header: dict[str, Any]) -> Iterator[str]:
    x_min, x_max, y_min, y_max = area = header.get("area_m", [0, 1, 0, 1])
    if min(x_max - x_min, y_max - y_min) < SMALLEST_AREA or max(map(abs, area)) > FARTHEST:
        yield (
            f"area_m is {area}: sides of {x_max - x_min:g} m and {y_max - y_min:g} m are no place "
            "to fly in: give metres"
        )
    try:
        if "rectification" in header:
            Rectification.from_table(header["rectification"])
    except ParameterError as error:
        yield f"[rectification]: {error}"
