"""JSON lines: one object a fix, on standard output or in a file; events too, which makes it the
log."""

from __future__ import annotations

import json
from typing import Any

from trexton.base.options import Options
from trexton.base.records import plain
from trexton.onboard.fix import Fix
from trexton.onboard.sinks.base import Sink, Surroundings
from trexton.onboard.sinks.lines import LineFile

__all__ = ["JsonLines", "row"]


def row(fix: Fix) -> dict[str, Any]:
    """A fix as JSON values: what is not finite becomes null."""
    told = fix.told
    values: Any = plain(
        {
            "time_s": fix.time,
            "frame": fix.number,
            "x_m": fix.position[0],
            "y_m": fix.position[1],
            "std_x_m": fix.spread[0],
            "std_y_m": fix.spread[1],
            "covariance_m2": [fix.covariance[0, 0], fix.covariance[0, 1], fix.covariance[1, 1]],
            "observed": fix.observed,
            "lost": fix.lost,
            "stale": fix.stale,
            "resets": fix.resets,
            "latency_s": fix.latency,
            "fault": fix.fault,
            "told_m": told.position,
            "told_covariance_m2": [
                told.covariance[0, 0], told.covariance[0, 1], told.covariance[1, 1],
            ],
        }
    )  # fmt: skip
    return dict(values)


class JsonLines(Sink):
    """Fixes as JSON lines; with `events` it is a log: events are lines as well, and an old file
    is kept."""

    addresses = {
        "json": "one object a line on standard output; the default",
        "json:FILE": "the same in a file",
    }

    def __init__(self, path: str, events: bool = False, most_bytes: int | None = None):
        self.name, self.file = f"json:{path or '-'}", path
        self._file, self._events = LineFile(path, keep=events, most_bytes=most_bytes), events

    @classmethod
    def make(cls, address: str, options: Options, around: Surroundings) -> JsonLines:
        return cls(address)

    def open(self) -> None:
        self._file.open()

    def write(self, fix: Fix) -> None:
        self._file.write(json.dumps(row(fix), allow_nan=False))

    def event(self, event: dict[str, Any]) -> None:
        if self._events:
            self._file.write(json.dumps(plain(event), allow_nan=False))

    def close(self) -> None:
        self._file.close()
