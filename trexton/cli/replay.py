"""``trexton replay LOG``: show what a flight of the script sent, and what the autopilot said.

`replayed` gives a line for each thing that happened, what was sent beside what was answered."""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from trexton.base.errors import DataError
from trexton.base.progress import shown

__all__ = ["add_arguments", "replayed", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", metavar="LOG", help="what trexton onboard --log wrote")


def run(arguments: argparse.Namespace) -> int:
    for line in replayed(arguments.log):
        print(line)
    return 0


def rows(path: str | Path) -> Iterator[dict[str, Any]]:
    """The lines of a log, in order; raises `DataError` where none is one.

    A computer that loses its power in the air, which is when a log is wanted most, leaves half a
    line behind, or zeros: such a line becomes an event, and what follows it is read.
    """
    first: DataError | None = None  # what is wrong, until one is right
    good = 0
    try:
        with open(path, encoding="utf-8-sig", errors="backslashreplace") as stream:
            for number, line in enumerate(stream, 1):
                row, fault = _parsed(line)
                if fault is None:
                    good += 1
                    yield row
                elif good:
                    yield {"event": "damaged line", "number": number, "why": fault}
                else:
                    first = first or DataError(
                        f"{path}: line {number} is none of a log ({fault}): give what --log wrote"
                    )
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}): give a log") from None
    if first is not None and not good:
        raise first


def replayed(path: str | Path) -> Iterator[str]:
    """A line for each thing that happened, jumps of the position among them, with the position that
    was sent last before it; and one that counts fixes, those that were fit to be sent, faults and
    each kind of event.

    Status lines are left out: they repeat what the rest tells. The log is read once: it may come
    through a pipe.

    Raises
    ------
    DataError
        It cannot be read, is no log, or is empty.
    """
    sent, usable, resets = "nothing sent yet", True, 0
    counts: Counter[str] = Counter()
    for row in rows(path):
        counts.update(_counted(row))
        if "event" not in row:
            fit = _fit(row)
            if fit:
                x, y = row["measurement_m"]
                sent = f"sent x {x:.2f} y {y:.2f} m"
            if fit != usable:
                word = "positions are sent again" if fit else f"silence: {_why(row)}"
                yield f"{_time(row)}  {sent:28}  {word}"
            if row.get("resets", 0) > resets:
                resets = row["resets"]
                yield f"{_time(row)}  {sent:28}  reset {resets}: the position jumped"
            usable = fit
        elif row["event"] != "status":
            rest = {key: value for key, value in row.items() if key not in ("event", "time_s")}
            words = ", ".join(f"{_short(key)} {_short(value)}" for key, value in rest.items())
            yield f"{_time(row)}  {sent:28}  {_short(row['event'])}: {words}"
    if not counts:
        raise DataError(f"{path}: empty: give what --log wrote")
    yield ", ".join(f"{name} {count}" for name, count in counts.items())


def _counted(row: dict[str, Any]) -> dict[str, int]:
    """What a row counts for: a fix, fit to be sent, its fault; or an event of a kind."""
    if "event" in row:
        return {f"event {_short(row['event'])}": 1}
    fault = {f"fault {_short(row['fault'])}": 1} if row["fault"] else {}
    return {"fixes": 1, "sent": int(_fit(row))} | fault


def _parsed(line: str) -> tuple[Any, str | None]:
    """The row of a line, and what keeps it from being one of a log."""
    try:
        row = json.loads(line)
        time = row.get("time_s")
        numbers = [0.0 if time is None else time, row.get("resets", 0)]
        if "event" not in row:
            if "told_m" in row:  # as logs of version 0.1.0 call it
                row["measurement_m"] = row["told_m"]
            x, y = row["measurement_m"] if _fit(row) else (0.0, 0.0)
            numbers += [x, y, row["fault"] is None]
        if not all(abs(number) < 1e12 for number in numbers):
            raise ValueError("a number out of range")
        return row, None
    except (ValueError, RecursionError) as error:
        return None, str(error)
    except (AttributeError, KeyError, TypeError) as error:
        return None, f"none of a position or an event: {error}"


def _fit(row: dict[str, Any]) -> bool:
    """Was it sent to whoever steers by it?"""
    return bool(row["observed"] and not row["lost"] and not row["stale"])


def _time(row: dict[str, Any]) -> str:
    time = row.get("time_s")
    return "         -" if time is None else f"{time:10.2f}"


def _why(row: dict[str, Any]) -> str:
    words = [word for word in ("lost", "stale") if row[word]]
    return " and ".join(words) or _short(row["fault"] or "no image")


def _short(value: object) -> str:
    """Few letters, all of them to be seen: an autopilot's words must not command a terminal."""
    text = shown(str(value), kept="")
    return text if len(text) <= 60 else text[:57] + "..."
