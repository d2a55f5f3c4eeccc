"""A TUM trajectory, ``time x y z qx qy qz qw``: only positions that a vehicle may steer by."""

from __future__ import annotations

from trexton.base.options import Options
from trexton.onboard.fix import Fix
from trexton.onboard.sinks.base import Sink, Surroundings
from trexton.onboard.sinks.lines import LineFile, named_file

__all__ = ["TumTrajectory"]


class TumTrajectory(Sink):
    """Usable, observed fixes in the map's axes; nothing measures height or attitude, which are
    0."""

    addresses = {"tum:FILE": "a trajectory for `evo` and its like, of positions fit to steer by"}

    def __init__(self, path: str):
        self.name, self.file = f"tum:{path}", path
        self._file = LineFile(path)

    @classmethod
    def make(cls, address: str, options: Options, around: Surroundings) -> TumTrajectory:
        return cls(named_file(address, around.kind))

    def open(self) -> None:
        self._file.open()

    def write(self, fix: Fix) -> None:
        if fix.usable and fix.observed:
            x, y = fix.position
            self._file.write(f"{fix.time:.6f} {x:.6f} {y:.6f} 0 0 0 0 1")

    def close(self) -> None:
        self._file.close()
