"""Tables of text as people have them, read by one reader; every fault names file and row.

`read_table` finds separators, decimal commas, comments and byte-order marks out; a `TextTable`
gives its columns as texts, numbers or stamps. No pandas: a vehicle has none.
"""

import csv
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from decimal import Decimal
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.files import read_text
from trexton.base.progress import shown

LENGTHS = {"m": 1.0, "cm": 0.01, "mm": 0.001}  # metres
TIMES = {"s": 10**9, "ms": 10**6, "us": 1000, "ns": 1, "d": 86400 * 10**9}  # nanoseconds
MOST_BACK = 3  # times that a clock is set back: more are rows out of order
_FEWEST_PLACES = 5  # by which a path is known
_LATEST = 4_102_444_800 * TIMES["s"]  # the year 2100: stamps since 1970 are of before
# Date, hour, what follows it, AM or PM, zone: a minute alone may be one of an hour or of nothing.
_TIME = re.compile(
    r"(?:(\d{4})[-:/](\d\d?)[-:/](\d\d?)[T ]+(?=\d)|(?=\d+:\d+:))(\d\d?)(:[\d:.,]+)"
    r"\s*(?:([apAP])\.?[mM]\.?)?\s*([-+]\d\d:?\d\d)?(?:Z|UTC|GMT)?"
)
_MISSING = ("", "na", "n/a", "#n/a", "null", "none", "nil", "-", "--", "-nan(ind)", "1.#qnan")


@dataclass(frozen=True, eq=False)
class TextTable:
    """The cells of a table as text.

    Attributes
    ----------
    path : Path
    cells : dict of str to sequence of str
        A column each, in the order of the file.
    rows : sequence of int
        The number of each row in the file, as editors count.
    decimal : str
        The decimal point.
    """

    path: Path
    cells: Mapping[str, Sequence[str]]
    rows: Sequence[int]
    decimal: str = "."

    @property
    def header(self) -> list[str]:
        """The names of the columns."""
        return list(self.cells)

    def __len__(self) -> int:
        return len(self.rows)

    def texts(self, name: str) -> list[str]:
        """A column as it is written; raises `FlightError` where there is none of that name."""
        if name not in self.cells:
            there = ", ".join(self.header)
            words = f"no column {name!r}: it has {shown(there, kept='')}: name it"
            raise FlightError(f"{self.path}: {words}")
        return [cell.strip() for cell in self.cells[name]]

    def numbers(self, name: str, missing_allowed: bool = True) -> np.ndarray:
        """``(N,) float64`` column; a missing value is NaN.

        Raises
        ------
        FlightError
            There is no such column, or a row of it holds something else.
        """
        texts = self.texts(name)
        if self.decimal == ",":
            texts = [text.replace(",", ".") for text in texts]
        try:
            values = np.array(texts, dtype=np.float64)
        except ValueError:
            values = np.array([self._number(name, row, text) for row, text in enumerate(texts)])
        odd = np.isinf(values) if missing_allowed else ~np.isfinite(values)
        if odd.any():
            raise self._refusal(name, int(odd.argmax()), "expected a finite number")
        return values

    def nanoseconds(self, name: str, unit: str = "s") -> np.ndarray:
        """``(N,) int64`` stamps, exact: floats would lose microseconds. Dates count from 1970.

        Raises
        ------
        FlightError
            There is no such column, or a stamp is none or beyond the year 2262.
        """
        stamps = np.empty(len(self), dtype=np.int64)
        for row, text in enumerate(self.texts(name)):
            if ":" in text:
                stamps[row] = time_of(f"{self.path}, row {self.rows[row]}", text)
                continue
            try:
                stamp = Decimal(text.replace(",", ".")) * TIMES[unit]
                if not stamp.is_finite():
                    raise ValueError(text)
            except (ArithmeticError, ValueError):
                raise self._refusal(name, row, f"expected a stamp in {unit}") from None
            if abs(stamp) >= 2**63:
                likely = next(
                    (each for each in TIMES if abs(stamp) / TIMES[unit] * TIMES[each] < _LATEST), ""
                )
                hint = f"give --time-unit {likely}" if likely else "count from the first"
                hint = "give all stamps in the unit of the first" if row else hint
                raise self._refusal(name, row, f"in {unit} that is beyond the year 2262: {hint}")
            stamps[row] = int(stamp.to_integral_value())
        if unit in ("ms", "us"):  # counters of 32 bits begin anew
            share = stamps / (full := 2**32 * TIMES[unit])
            anew = (share[:-1] > 0.99) & (share[:-1] < 1) & (share[1:] >= 0) & (share[1:] < 0.01)
            stamps[1:] += full * np.cumsum(anew)
        return stamps

    def _number(self, name: str, row: int, text: str) -> float:
        try:
            return np.nan if text.lower() in _MISSING else float(text)
        except ValueError:
            decimal_comma = text.count(",") == 1 and self.decimal != ","
            point = " with a decimal point" if decimal_comma else ""
            raise self._refusal(name, row, f"expected a number{point}") from None

    def _refusal(self, name: str, row: int, expected: str) -> FlightError:
        found = repr(text) if (text := self.cells[name][row].strip()[:40]) else "empty"
        return FlightError(f"{self.path}, row {self.rows[row]}: {name} is {found}: {expected}")


def time_of(where: object, text: str) -> int:
    """Nanoseconds since 1970 of an EXIF time such as ``2013:06:04 13:37:29``, or one of ISO 8601.

    It is taken as UTC where it tells no zone, as of 1970 where it tells no date; zero where a
    camera without a clock wrote it. An hour 24 is that after midnight of the same date, as phones
    mean it; AM and PM count to 12.

    Raises
    ------
    FlightError
        It is no time, or beyond the year 2262.
    """
    if not text.strip(" 0:."):
        return 0
    try:
        moment = datetime.fromisoformat(_iso(text))
        moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
        stamp = round(moment.timestamp() * 1e6) * 1000
        if abs(stamp) < 2**63:
            return stamp
    except ValueError:
        pass
    raise FlightError(
        f"{where}: {text[:40]!r} is no time: expected one such as 2013:06:04 13:37:29"
    )


def _iso(text: str) -> str:
    """A time as ISO 8601 writes it; texts that are none as they are."""
    if (parts := _TIME.fullmatch(text.strip())) is None:
        return text.strip()
    year, month, day, hour, rest, half, zone = parts.groups()
    date = f"{year}-{month:0>2}-{day:0>2}" if year else "1970-01-01"
    clock = 0 if hour == "24" else int(hour)
    if half:
        clock = clock % 12 + 12 * (half in "pP") if clock <= 12 else 99
    return f"{date} {clock:02}{rest}{zone or ''}"


def is_number(text: str) -> bool:
    """Whether a cell holds a number, as in a file without a header."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def read_table(path: Path, names: Sequence[str] = ()) -> TextTable:
    """A table with a header, or with `names` where it has none.

    Comma, semicolon, tab or blanks separate. A ``#`` before the header is dropped, lines that
    begin with one are comments, rows without any text are passed over. Where commas do not
    separate, they may be decimal.

    Raises
    ------
    FlightError
        The file cannot be read, has no rows, a name twice, or a row has another number of fields.
    """
    text = read_text(path)
    lines = (line for line in text.splitlines() if line.strip())
    first = next((line for line in lines if not (names and line.lstrip().startswith("#"))), "")
    if first.startswith("# CoordinateSystem:"):  # of Metashape, before its names
        text, first = text.replace(first, "", 1), next(lines, "")
    if first[:1] in ("<", "{"):
        raise FlightError(f"{path}: XML or JSON, and a table was expected: export it as CSV")
    separator = next((each for each in ";\t," if each in first), " ")
    stream = io.StringIO(text, newline="")
    try:
        reader = csv.reader(stream, delimiter=separator, skipinitialspace=True)
        table = [(reader.line_num, row) for row in reader if any(cell.strip() for cell in row)]
    except csv.Error as error:
        raise FlightError(f"{path}: not a text table ({error}): write it as UTF-8 CSV") from None
    if not names and table:
        head = [name.strip() for name in table.pop(0)[1]]
        head[0] = head[0].lstrip("# ")
        names = [name for name in head if name or separator != " "]
    table = [(number, row) for number, row in table if not row[0].lstrip().startswith("#")]
    if not table:
        raise FlightError(f"{path}: no rows: expected a table, a row a line")
    if twice := [name for name in names if name and list(names).count(name) > 1]:
        hint = "give a first row of names" if is_number(twice[0]) else "name each column once"
        raise FlightError(f"{path}: column {twice[0]!r} appears twice: {hint}")
    for number, row in table:
        if len(row) < len(names) or any(cell.strip() for cell in row[len(names) :]):
            hint = "complete the row" if len(row) < len(names) else "remove the extra fields"
            if separator == "," and len(names) < len(row) <= 2 * len(names):
                hint += "; decimal commas must become points"
            raise FlightError(
                f"{path}, row {number}: {len(row)} fields where {len(names)} are named "
                f"({shown(', '.join(names[:6]), kept='')}): {hint}"
            )
    cells = dict(
        zip(names, zip(*(row[: len(names)] for _, row in table), strict=True), strict=True)
    )
    comma = separator != "," and any("," in cell for column in cells.values() for cell in column)
    decimal = "," if comma else "."
    return TextTable(path, cells, [number for number, _ in table], decimal)


def counted_on(time: np.ndarray, place: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Stamps that go on by the usual step where a clock was set back, and the rows where it was:
    those with an earlier stamp than the row before, if the path is shorter as the rows lie than by
    their stamps.

    Parameters
    ----------
    time : (N,) array
        In the order of the rows.
    place : (N, 2) array
        Metres; NaN where there is none.
    """
    back, known = np.flatnonzero(np.diff(time) < 0) + 1, np.isfinite(place).all(axis=1)
    if not 0 < len(back) <= MOST_BACK or known.sum() < _FEWEST_PLACES:
        return time, back[:0]
    place = place[known]
    steps, by_stamps = (
        np.hypot(*np.diff(each, axis=0).T)
        for each in (place, place[np.argsort(time[known], kind="stable")])
    )
    if by_stamps.sum() - steps.sum() <= 3 * np.median(steps):
        return time, back[:0]
    gaps, time = np.diff(time), time.copy()
    for row in back:
        time[row:] += np.median(gaps[gaps > 0]).astype(time.dtype) - gaps[row - 1]
    return time, back
