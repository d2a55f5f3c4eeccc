"""Poses of photographs that were reconstructed from the pictures: COLMAP's ``images.txt`` and
OpenSfM's ``reconstruction.json``; `read_reconstruction` finds out which it is.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.files import read_text
from trexton.flights.importers.axes import camera_attitude
from trexton.flights.importers.recording import PoseTrack

__all__ = ["read_reconstruction"]


def read_reconstruction(path: Path) -> tuple[list[str], PoseTrack, list[str]] | None:
    """The names of the photographs, their poses (all at time 0), and what to know; None for others.

    Raises
    ------
    FlightError
        The file is one, but cannot be read.
    """
    from scipy.spatial.transform import Rotation

    if path.suffix.lower() not in (".json", ".txt"):
        return None
    text, origin = read_text(path), None
    try:
        if path.suffix.lower() == ".json":
            whole = json.loads(text)[0]
            names, turns, shifts = _opensfm(whole)
            told = whole.get("reference_lla")
            origin = (float(told["latitude"]), float(told["longitude"])) if told else None
        elif "IMAGE_ID" in text[:2000] or "QW" in text[:2000]:
            names, turns, shifts = _colmap(text)
        else:
            return None
        # Both tell how the world is turned and moved to the camera (right, down, ahead).
        to_world = Rotation.from_quat(np.array(turns, dtype=float)).inv()
        centres = -to_world.apply(np.array(shifts, dtype=float))
    except (AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
        raise FlightError(f"{path}: not a reconstruction that can be read ({error})") from None
    attitude, said = camera_attitude(to_world.as_quat(), "camera")
    scale = "" if origin else "; its unit and axes are its own, unless it was aligned"
    said = [f"{path}: {len(names)} poses of a reconstruction{scale}", *said[1:]]
    zero = np.zeros(len(names), dtype=np.int64)
    return names, PoseTrack(zero, centres, attitude, origin), said


Poses = tuple[list[str], list[Any], list[Any]]


def _colmap(text: str) -> Poses:
    """Two lines an image: id, quaternion w, x, y, z, translation, camera, name; then its points."""
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    rows = [line.split(maxsplit=9) for line in lines[::2] if line.strip()]
    turns = [[float(row[place]) for place in (2, 3, 4, 1)] for row in rows]
    return [row[9].strip() for row in rows], turns, [[float(x) for x in row[5:8]] for row in rows]


def _opensfm(whole: dict[str, Any]) -> Poses:
    from scipy.spatial.transform import Rotation

    shots = whole["shots"]
    turns = [Rotation.from_rotvec(shot["rotation"]).as_quat() for shot in shots.values()]
    return list(shots), turns, [shot["translation"] for shot in shots.values()]
