"""``flight.toml``: the header of a Flight folder, read with every fault named, and written."""

from __future__ import annotations

import json
import math
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import FlightError, ParameterError
from trexton.flights.flight import Flight
from trexton.flights.tables import read_text
from trexton.vision.camera import Camera
from trexton.vision.rectification import Rectification

__all__ = ["FORMAT", "camera_from_header", "header_text", "read_header"]

FORMAT = 1
SMALLEST_AREA = 1e-3  # metres
_KEYS = (
    "format",
    "name",
    "source",
    "licence",
    "area_m",
    "notes",
    "features",
    "camera",
    "split",
    "floor",
    "origin",
    "rectification",
)
_TEXTS = ("name", "source", "licence", "features")
_TABLES = {
    "camera": ("width_px", "height_px", "focal_px"),
    "floor": ("image", "world_from_pixel"),
    "origin": ("latitude_deg", "longitude_deg"),
    "rectification": (
        "source_px",
        "crop_px",
        "size_px",
        "focal_px",
        "center_px",
        "distortion",
    ),
    "split": (),
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
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        return None, [f"{path}: not valid TOML ({error}): correct it"]
    faults = [f"{path}: {fault}" for fault in _faults(header)]
    return (None if faults else header), faults


def _faults(header: dict[str, Any]) -> list[str]:
    if unknown := sorted(set(header) - set(_KEYS)):
        return [f"unknown key {unknown[0]!r}: the keys are {', '.join(sorted(_KEYS))}"]
    version = header.get("format", FORMAT)
    if not isinstance(version, int) or version > FORMAT:
        return [
            f"format {version} is newer than {FORMAT}, the newest this version reads: update "
            "trexton"
        ]
    faults = [
        f"{key} is {header[key]!r}: expected text"
        for key in _TEXTS
        if not isinstance(header.get(key, ""), str)
    ]
    notes = header.get("notes", [])
    if not isinstance(notes, list) or not all(isinstance(note, str) for note in notes):
        faults.append(f"notes is {notes!r}: expected a list of texts")
    for key, required in _TABLES.items():
        if not isinstance(table := header.get(key, {}), dict):
            faults.append(f"{key} is {table!r}: expected a table [{key}]")
        elif key in header and (missing := [name for name in required if name not in table]):
            faults.append(
                f"[{key}] lacks {missing[0]}: give {', '.join(required)}, or drop the table"
            )
    return faults or _fault_values(header)


def _fault_values(header: dict[str, Any]) -> list[str]:
    faults = []
    area = header.get("area_m", [0, 1, 0, 1])
    if not _numbers(area, 4) or area[0] >= area[1] or area[2] >= area[3]:
        faults.append(f"area_m is {area}: expected [x_min, x_max, y_min, y_max] in metres")
    elif min(area[1] - area[0], area[3] - area[2]) < SMALLEST_AREA or max(map(abs, area)) > 2e7:
        faults.append(
            f"area_m is {area}: sides of {area[1] - area[0]:g} m and {area[3] - area[2]:g} m are "
            "no place to fly in: give metres"
        )
    for name, limits in header.get("split", {}).items():
        if not (
            isinstance(limits, list)
            and len(limits) == 2
            and all(type(n) is int for n in limits)
            and limits[0] <= limits[1]
        ):
            faults.append(f"split {name!r} is {limits}: expected [first frame, last frame]")
    if camera := header.get("camera"):
        sizes = [camera["width_px"], camera["height_px"]]
        if (
            not all(type(size) is int and size > 0 for size in sizes)
            or not _numbers([camera["focal_px"]], 1)
            or camera["focal_px"] <= 0
        ):
            faults.append(
                f"[camera] is {sizes[0]} x {sizes[1]} pixels, focal length {camera['focal_px']}: "
                "expected positive numbers"
            )
        if not _numbers(camera.get("center_px", [0, 0]), 2):
            faults.append(
                f"[camera] center_px is {camera['center_px']}: expected [column, row] in pixels"
            )
    if origin := header.get("origin"):
        degrees = [origin["latitude_deg"], origin["longitude_deg"]]
        if not (_numbers(degrees, 2) and abs(degrees[0]) <= 90 and abs(degrees[1]) <= 180):
            faults.append(
                f"[origin] is {degrees}: expected degrees of latitude, -90 to 90, and of "
                "longitude, -180 to 180"
            )
    if rectified := header.get("rectification"):
        try:
            Rectification.from_table(rectified)
        except ParameterError as error:
            faults.append(f"[rectification]: {error}")
    if floor := header.get("floor"):
        rows = floor["world_from_pixel"]
        if (
            not isinstance(rows, list)
            or len(rows) != 3
            or not all(_numbers(row, 3) for row in rows)
        ):
            faults.append(
                f"[floor] world_from_pixel is {rows}: expected three rows of three numbers"
            )
        elif not _turns_back(rows):
            faults.append(
                f"[floor] world_from_pixel is {rows}: it maps the picture to a line or a point, "
                "measure it again"
            )
        if not isinstance(floor["image"], str):
            faults.append(f"[floor] image is {floor['image']!r}: expected a file name")
    return faults


def _numbers(values: object, count: int) -> bool:
    if not isinstance(values, list) or len(values) != count:
        return False
    return all(type(value) in (int, float) and _finite(value) for value in values)


def _finite(value: float) -> bool:
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number beyond all floats
        return False


def _turns_back(rows: list[list[float]]) -> bool:
    """Whether a homography can be inverted, whatever the scales of its columns and rows."""
    matrix = np.array(rows, dtype=float)
    for axis in (0, 1):
        largest = np.abs(matrix).max(axis=axis, keepdims=True)
        if not (largest > 0).all():
            return False
        matrix = matrix / largest
    return bool(np.linalg.cond(matrix) < 1e10)


def camera_from_header(table: dict[str, Any]) -> Camera:
    """The camera that a [camera] table describes."""
    center = table.get("center_px")
    return Camera(
        table["width_px"],
        table["height_px"],
        float(table["focal_px"]),
        tuple(center) if center else None,
    )


def header_text(flight: Flight) -> str:
    """``flight.toml`` for `flight`."""

    def text(value: str) -> str:
        return json.dumps(value, ensure_ascii=False)  # a JSON string is a valid TOML basic string

    lines = [f"format = {FORMAT}", f"name = {text(flight.name)}", f"source = {text(flight.source)}"]
    lines += [
        f"licence = {text(flight.licence)}",
        f"area_m = {[float(value) for value in flight.area]}",
    ]
    if flight.features != "textons":
        lines.append(f"features = {text(flight.features)}")
    if flight.notes:
        lines.append(f"notes = [{', '.join(text(note) for note in flight.notes)}]")
    if flight.split:
        lines += ["", "[split]"] + [
            f"{text(key)} = [{first}, {last}]" for key, (first, last) in flight.split.items()
        ]
    if flight.camera is not None:
        camera = flight.camera
        lines += ["", "[camera]", f"width_px = {camera.width}", f"height_px = {camera.height}"]
        lines += [
            f"focal_px = {float(camera.focal)}",
            f"center_px = {[float(value) for value in camera.principal_point]}",
        ]
    if flight.rectification is not None:
        table = flight.rectification.table()
        lines += ["", "[rectification]"] + [f"{key} = {value}" for key, value in table.items()]
    if flight.origin is not None:
        latitude, longitude = map(float, flight.origin)
        lines += [
            "", "[origin]", f"latitude_deg = {latitude}", f"longitude_deg = {longitude}"
        ]  # fmt: skip
    if flight.floor_file is not None:
        matrix = np.asarray(flight.floor_from_pixel, dtype=float).tolist()
        lines += [
            "",
            "[floor]",
            f"image = {text(flight.floor_file.name)}",
            f"world_from_pixel = {matrix}",
        ]
    return "\n".join(lines) + "\n"
