"""A TUM trajectory, ``time x y z qx qy qz qw``: only positions that a vehicle may steer by."""

from __future__ import annotations

from trexton.errors import ParameterError
from trexton.onboard.fix import Fix
from trexton.onboard.sinks.base import Sink, SinkOptions
from trexton.onboard.sinks.lines import LineFile

__all__ = ["TumTrajectory", "make"]


def make(address: str, options: SinkOptions) -> Sink:
    path = address.partition(":")[2]
    if not path:
        raise ParameterError(
            "output 'tum' names no file: give tum:FILE, or tum:- for standard output"
        )
    return TumTrajectory(path, options.local.height)


class TumTrajectory(Sink):
    """Usable, observed fixes in the map's axes; the height is the constant one, the attitude none."""

    def __init__(self, path: str, height: float):
        self.name = f"tum:{path}"
        self._file, self._height = LineFile(path), height

    def open(self) -> None:
        self._file.open()

    def write(self, fix: Fix) -> None:
        if fix.usable and fix.observed:
            x, y = fix.position
            self._file.write(f"{fix.time:.6f} {x:.6f} {y:.6f} {self._height:.6f} 0 0 0 1")

    def close(self) -> None:
        self._file.close()
