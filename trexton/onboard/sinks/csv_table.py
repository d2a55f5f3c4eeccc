"""A CSV table: one row a fix; cells of what is not finite stay empty."""

from __future__ import annotations

from trexton.errors import ParameterError
from trexton.onboard.fix import Fix
from trexton.onboard.sinks.base import Sink, SinkOptions
from trexton.onboard.sinks.json_lines import row
from trexton.onboard.sinks.lines import LineFile

__all__ = ["COLUMNS", "CsvTable", "make"]

COLUMNS = (
    "time_s", "frame", "x_m", "y_m", "std_x_m", "std_y_m", "observed", "lost", "stale", "resets", "latency_s", "fault",
)  # fmt: skip


def make(address: str, options: SinkOptions) -> Sink:
    path = address.partition(":")[2]
    if not path:
        raise ParameterError(
            "output 'csv' names no file: give csv:FILE, or csv:- for standard output"
        )
    return CsvTable(path)


class CsvTable(Sink):
    """Fixes as rows under `COLUMNS`; flags are 0 or 1."""

    def __init__(self, path: str):
        self.name = f"csv:{path}"
        self._file = LineFile(path, ",".join(COLUMNS))

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
