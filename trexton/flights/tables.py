"""Tables as people have them: separators, decimal commas, byte-order marks and units are found
out.
"""

from __future__ import annotations

import io
import re
import stat
from pathlib import Path
from typing import TYPE_CHECKING

from trexton.base.errors import FlightError

if TYPE_CHECKING:
    import pandas as pd

__all__ = ["LARGEST", "column", "read_table", "read_text"]

LARGEST = 2**30  # bytes of a table: more is a mistake, or meant to fill the memory


def read_text(path: Path) -> str:
    """The text of a regular file, its byte-order mark removed.

    Raises
    ------
    FlightError
        There is no such file, it is a device or a pipe, too large, or no text.
    """
    try:
        status = path.stat()
        if not stat.S_ISREG(status.st_mode):
            raise FlightError(f"{path}: not a regular file: expected a text file")
        if status.st_size > LARGEST:
            raise FlightError(f"{path}: {status.st_size:,} bytes: expected at most {LARGEST:,}")
        return path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise FlightError(f"{path}: cannot be read ({error.strerror}): check the path") from None
    except UnicodeDecodeError as error:
        raise FlightError(f"{path}: not a text file ({error}): write it as UTF-8") from None


def read_table(path: Path, names: list[str] | None = None) -> pd.DataFrame:
    """A table with a header, or with `names` where it has none; numbers where a column holds only
    numbers.

    Comma, semicolon, tab or blanks separate; a ``#`` before the header is dropped, lines that begin
    with one are comments; with semicolons or tabs a comma may be the decimal point.

    Raises
    ------
    FlightError
        The file cannot be read, or has no rows.
    """
    import pandas as pd

    lines = [line for line in read_text(path).splitlines() if line.strip(" ,;\t")]
    if names is None and lines:
        header, lines = lines[0].lstrip("# \t"), lines[1:]
    else:
        header = ""
    lines = [line for line in lines if not line.lstrip().startswith("#")]
    if not lines:
        raise FlightError(f"{path}: no rows: expected a table of numbers")
    separator = next((each for each in ";\t," if each in lines[0]), r"\s+")
    decimal = "," if separator in ";\t" and any("," in line for line in lines) else "."
    if names is None:
        names = [name.strip().strip('"') for name in re.split(separator, header.strip())]
    try:
        table = pd.read_csv(
            io.StringIO("\n".join(lines)),
            sep=separator,
            decimal=decimal,
            header=None,
            skipinitialspace=True,
            engine="python" if len(separator) > 1 else "c",
        )
    except (pd.errors.ParserError, ValueError, OverflowError) as error:
        reason = " ".join(str(error).split())
        raise FlightError(
            f"{path}: not a table ({reason[:200]}): every row needs as many fields"
        ) from None
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise FlightError(f"{path}: column {twice[0]!r} appears twice: name each column once")
    if len(table.columns) < len(names):
        raise FlightError(
            f"{path}: rows have {len(table.columns)} fields where {len(names)} are named "
            f"({', '.join(names[:6])}): complete the rows"
        )
    table = table.iloc[:, : len(names)]
    table.columns = pd.Index(names)
    return table


def column(path: Path, table: pd.DataFrame, name: str) -> pd.Series[float]:
    """The numbers of a column.

    Raises
    ------
    FlightError
        There is no such column, or it holds something else.
    """
    import pandas as pd

    if name not in table.columns:
        there = ", ".join(str(each) for each in table.columns)
        raise FlightError(f"{path}: no column {name!r}: it has {there}")
    try:
        values = pd.to_numeric(table[name], errors="coerce").astype(float)
    except OverflowError:
        raise FlightError(f"{path}: {name} holds a whole number beyond all others") from None
    wrong = values.isna() & table[name].notna() & (table[name].astype(str).str.strip() != "")
    if wrong.any():
        row = int(wrong.to_numpy().argmax())
        raise FlightError(
            f"{path}, row {row + 2}: {name} is {table[name].iloc[row]!r}: expected a number"
        )
    return values.astype(float)
