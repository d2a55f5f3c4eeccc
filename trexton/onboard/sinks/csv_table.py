"""A CSV table: one row a fix; cells of what is not finite stay empty."""

from __future__ import annotations

from trexton.base.options import Options
from trexton.onboard.fix import Fix
from trexton.onboard.sinks.base import Sink, Surroundings
from trexton.onboard.sinks.json_lines import row
from trexton.onboard.sinks.lines import LineFile, named_file

__all__ = ["COLUMNS", "CsvTable"]

COLUMNS = (
    "time_s", "frame", "x_m", "y_m", "std_x_m", "std_y_m",
    "observed", "lost", "stale", "resets", "latency_s", "fault",
)  # fmt: skip


class CsvTable(Sink):
    """Fixes as rows under `COLUMNS`; flags are 0 or 1."""

    addresses = {"csv:FILE": "a table, a row a frame, numbered as the flight numbers it"}

    def __init__(self, path: str):
        self.name, self.file = f"csv:{path}", path
        self._file = LineFile(path, ",".join(COLUMNS))

    @classmethod
    def make(cls, address: str, options: Options, around: Surroundings) -> CsvTable:
        return cls(named_file(address, around.kind))

    def open(self) -> None:
        self._file.open()

    def write(self, fix: Fix) -> None:
        values = row(fix)
        cells = [
            int(value) if isinstance(value, bool) else value for value in map(values.get, COLUMNS)
        ]
        self._file.write(",".join("" if cell is None else str(cell) for cell in cells))

    def close(self) -> None:
        self._file.close()
