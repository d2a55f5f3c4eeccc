"""Tracks of flights in formats that others read: a function each.

An exporter takes a `Flight`, all of whose frames have a position, and a stream of text. It is a
line in `EXPORTERS`, an entry point or ``module:function``; `export` writes the track.
"""

from __future__ import annotations

from pathlib import Path
from typing import IO

import numpy as np

from trexton.base.files import atomic_file
from trexton.base.plugins import resolve
from trexton.flights.flight import Flight

__all__ = ["EXPORTERS", "export"]

EXPORTERS = {"tum": "trexton.flights.exporters:write_tum"}


def write_tum(flight: Flight, stream: IO[str]) -> None:
    """TUM: ``stamp x y z qx qy qz qw``, seconds and metres, as evo reads it; the quaternion turns a
    vehicle whose x points forward (REP 103). What is not known of z and yaw is 0.
    """
    height = np.zeros(len(flight)) if flight.height is None else flight.height
    yaw = np.zeros(len(flight)) if flight.attitude is None else flight.attitude[:, 2]
    # A vehicle of yaw 0 flies along y (`trexton.vision.camera`).
    half = (np.nan_to_num(yaw) + np.pi / 2) / 2
    flat = np.zeros((len(flight), 2))
    columns = [
        flight.time,
        flight.position,
        np.nan_to_num(height),
        flat,
        np.sin(half),
        np.cos(half),
    ]
    np.savetxt(stream, np.column_stack(columns), fmt="%.9f")


def export(flight: Flight, kind: str, path: Path) -> Path:
    """Write the located frames as `kind`, an entry of `EXPORTERS`, an entry point in the group
    ``trexton.exporters`` or ``module:function``; whole or not at all.

    Raises
    ------
    ParameterError
        There is no such kind.
    """
    write = resolve("exporters", kind, EXPORTERS)
    with atomic_file(path) as stream:
        write(flight.select(flight.located), stream)
    return path
