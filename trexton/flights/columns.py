"""The tables of a Flight folder, column by column, with every fault named by file and row.

Read without pandas, which is not there on a vehicle. What spreadsheets make of a table is read as
it is meant: a byte-order mark, semicolons or tabs between the fields, decimal commas where these
separate, empty rows at the end.
"""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError
from trexton.flights.tables import read_text

__all__ = ["Table", "read_columns"]


@dataclass(frozen=True, eq=False)
class Table:
    """The cells of a table as text.

    Attributes
    ----------
    path : Path
    header : list of str
    cells : dict of str to tuple of str
        A column each; of columns with one name the last.
    rows : list of int
        The number of each row in the file, as editors count.
    warnings : list of str
        How it was read, where that is not how it should be written.
    """

    path: Path
    header: list[str]
    cells: dict[str, tuple[str, ...]]
    rows: list[int]
    decimal: str
    warnings: list[str]

    def numbers(self, name: str, missing_allowed: bool = False) -> np.ndarray:
        """``(N,) float64`` column; a missing value is NaN.

        Raises
        ------
        FlightError
            Naming the first row with something else.
        """
        cells = self.cells[name]
        if self.decimal == ",":
            cells = tuple(cell.replace(",", ".") for cell in cells)
        try:
            values = np.array(cells, dtype=np.float64)
        except ValueError:
            values = np.array([self._number(name, place, cell) for place, cell in enumerate(cells)])
        odd = ~np.isfinite(values) if not missing_allowed else np.isinf(values)
        if odd.any():
            place = int(odd.argmax())
            found = self.cells[name][place].strip() or "empty"
            raise FlightError(
                f"{self.path}, row {self.rows[place]}: {name} is {found}: expected a finite number"
            )
        return values

    def _number(self, name: str, place: int, cell: str) -> float:
        try:
            return float(cell) if cell.strip() else np.nan
        except ValueError:
            found = self.cells[name][place]
            hint = "expected a number"
            if found.count(",") == 1 and self.decimal != ",":
                hint = "expected a number with a decimal point"
            raise FlightError(
                f"{self.path}, row {self.rows[place]}: {name} is {found[:40]!r}: {hint}"
            ) from None


def read_columns(path: Path) -> Table:
    """Read a table with a header.

    Raises
    ------
    FlightError
        The file cannot be read, has no rows, or a row has another number of fields than the header.
    """
    text = read_text(path)
    first = text.split("\n", 1)[0]
    delimiter = max(",;\t", key=first.count)
    try:
        lines = csv.reader(io.StringIO(text, newline=""), delimiter=delimiter)
        table = [(lines.line_num, row) for row in lines if row]
    except csv.Error as error:
        raise FlightError(f"{path}: not a text table ({error}): write it as UTF-8 CSV") from None
    while table and not any(cell.strip() for cell in table[-1][1]):
        table.pop()
    if len(table) < 2:
        raise FlightError(f"{path}: no frames: expected a header and at least one row")
    header = [name.strip() for name in table[0][1]]
    for number, row in table[1:]:
        if len(row) != len(header):
            raise FlightError(_uneven(path, number, len(row), len(header), delimiter))
    rows = [number for number, _ in table[1:]]
    columns = tuple(zip(*(row for _, row in table[1:]), strict=True))
    cells = dict(zip(header, columns, strict=True))
    decimal = "," if delimiter != "," and _decimal_commas(header, cells) else "."
    warnings = []
    if delimiter != ",":
        word = {";": "semicolons", "\t": "tabs"}[delimiter]
        commas = " and decimal commas" if decimal == "," else ""
        warnings.append(
            f"{path}: written with {word}{commas}, and read so: commas and decimal points are usual"
        )
    return Table(path, header, cells, rows, decimal, warnings)


def _decimal_commas(header: list[str], cells: dict[str, tuple[str, ...]]) -> bool:
    """Whether some number of the first rows is written with a comma."""
    return any("," in cell for name in header if name != "image" for cell in cells[name][:100])


def _uneven(path: Path, number: int, found: int, expected: int, delimiter: str) -> str:
    hint = "complete the row"
    if delimiter == "," and expected < found <= 2 * expected:
        hint = "remove the extra fields; decimal commas must become points"
    return f"{path}, row {number}: {found} fields where the header names {expected}: {hint}"
