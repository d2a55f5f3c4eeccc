"""Files of positions: JSON lines (with events, the log), a CSV table, a TUM trajectory.

All write whole lines by `FileSink`, into a file or onto standard output.
"""

from __future__ import annotations

import json
from typing import Any, Self

import numpy as np

from trexton.base.records import plain
from trexton.onboard.fix import Fix
from trexton.onboard.sinks.base import Surroundings
from trexton.onboard.sinks.lines import FileSink

__all__ = ["COLUMNS", "CsvTable", "JsonLines", "TumTrajectory", "row"]

COLUMNS = (
    "time_s", "frame", "x_m", "y_m", "std_x_m", "std_y_m",
    "observed", "lost", "stale", "resets", "latency_s", "fault", "heading_rad", "heading_std_rad",
)  # fmt: skip


def row(fix: Fix) -> dict[str, Any]:
    """A fix as JSON values: what is not finite becomes null."""
    fusion = fix.fusion
    values: Any = plain(
        {
            "time_s": fix.time,
            "frame": fix.number,
            "x_m": fix.position[0],
            "y_m": fix.position[1],
            "std_x_m": fix.spread[0],
            "std_y_m": fix.spread[1],
            "covariance_m2": _upper(fix.covariance),
            "observed": fix.observed,
            "lost": fix.lost,
            "stale": fix.stale,
            "resets": fix.resets,
            "latency_s": fix.latency,
            "fault": fix.fault,
            "measurement_m": fusion.position,
            "measurement_covariance_m2": _upper(fusion.covariance),
            "heading_rad": fix.heading,
            "heading_std_rad": fix.heading_sigma,
        }
    )  # fmt: skip
    return dict(values)


def _upper(covariance: np.ndarray) -> list[float]:
    """xx, xy and yy of a ``(2, 2)`` covariance."""
    return [covariance[0, 0], covariance[0, 1], covariance[1, 1]]


class JsonLines(FileSink):
    """Fixes as JSON lines; with `events` it is a log: events are lines as well, and an old file
    is kept."""

    addresses = {
        "json": "one object a line on standard output; the default",
        "json:FILE": "the same in a file",
    }

    def __init__(self, path: str, events: bool = False, most_bytes: int | None = None):
        super().__init__(path or "-", keep=events, most_bytes=most_bytes)
        self._events = events

    @classmethod
    def make(cls, address: str, options: Any, around: Surroundings) -> Self:
        return super().make(address or "-", options, around)

    def write(self, fix: Fix) -> None:
        self.add(json.dumps(row(fix), allow_nan=False))

    def event(self, event: dict[str, Any]) -> None:
        if self._events:
            self.add(json.dumps(plain(event), allow_nan=False))


class CsvTable(FileSink):
    """Fixes as rows under `COLUMNS`; flags are 0 or 1, cells of what is not finite stay empty."""

    addresses = {"csv:FILE": "a table, a row a frame, numbered as the flight numbers it"}

    def __init__(self, path: str):
        super().__init__(path, ",".join(COLUMNS))

    def write(self, fix: Fix) -> None:
        values = row(fix)
        cells = [
            int(value) if isinstance(value, bool) else value for value in map(values.get, COLUMNS)
        ]
        self.add(",".join("" if cell is None else str(cell) for cell in cells))


class TumTrajectory(FileSink):
    """``time x y z qx qy qz qw``: observed fixes that a vehicle may steer by, in the map's axes.

    Nothing measures height, roll or pitch, which are 0. The quaternion turns the axis of the nose
    from the map's x to the heading; it is 0 0 0 1 where the frame does not show the heading.
    """

    addresses = {"tum:FILE": "a trajectory for `evo` and its like, of positions fit to steer by"}

    def write(self, fix: Fix) -> None:
        if fix.usable and fix.observed:
            x, y = fix.position
            turn = "0 1"
            if fix.heading is not None:
                half = (fix.heading + np.pi / 2) / 2
                turn = f"{np.sin(half):.6f} {np.cos(half):.6f}"
            self.add(f"{fix.time:.6f} {x:.6f} {y:.6f} 0 0 0 {turn}")
