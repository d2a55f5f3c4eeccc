"""``trexton replay LOG``: show what a flight of the script sent, and what the autopilot said.

`replayed` gives a line for each thing that happened, what was sent beside what was answered."""

import argparse
import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from trexton.base.errors import DataError
from trexton.base.progress import shown


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", metavar="LOG", help="what trexton onboard --log wrote")


def run(arguments: argparse.Namespace) -> int:
    for line in replayed(arguments.log):
        print(line)
    return 0


def replayed(path: str | Path) -> Iterator[str]:
    """A line for each event, silence and jump of the position, with the last usable position before
    it; and one that counts fixes, those that were usable, faults and each kind of event.

    Status lines are left out: they repeat what the rest tells. Raises `DataError` where it begins
    as no log, or is empty.
    """
    last, usable, resets, kind = "nothing usable yet", True, 0, ""
    counts: Counter[str] = Counter()
    for row in _rows(path):
        seconds = row.get("time_s")
        begin = f"{'-':>10}" if seconds is None else f"{seconds:10.2f}"
        kind = _short(row.pop("event", ""))
        if kind:
            counts[f"event {kind}"] += 1
            row.pop("time_s", None)
            words = ", ".join(f"{_short(key)} {_short(value)}" for key, value in row.items())
            if kind != "status":
                yield f"{begin}  {last:28}  {kind}: {words}"
            continue
        fit = _fit(row)
        counts.update({"fixes": 1, "usable": int(fit)})
        if row["fault"]:
            counts[f"fault {_short(row['fault'])}"] += 1
        if fit:
            x, y = row["measurement_m"]
            last = f"usable x {x:.2f} y {y:.2f} m"
        if fit != usable:
            why = [word for word in ("lost", "stale") if row[word]] or [row["fault"] or "no image"]
            word = "positions are usable again" if fit else f"silence: {_short(' and '.join(why))}"
            yield f"{begin}  {last:28}  {word}"
        if row.get("resets", 0) > resets:
            resets = row["resets"]
            yield f"{begin}  {last:28}  reset {resets}: the position jumped"
        usable = fit
    if not counts:
        raise DataError(f"{path}: empty: give what --log wrote")
    if kind != "end" and any(name.startswith("event") for name in counts):
        yield f"{'-':>10}  {last:28}  no end: the log is broken off, or still written"
    yield ", ".join(f"{name} {count}" for name, count in counts.items())


def _rows(path: str | Path) -> Iterator[dict[str, Any]]:
    """The lines of a log. A loss of power leaves half a line behind, or zeros: an event."""
    good = False
    with open(path, encoding="utf-8-sig", errors="backslashreplace") as stream:
        for number, line in enumerate(stream, 1):
            try:
                row = _checked(json.loads(line))
            except (AttributeError, LookupError, RecursionError, TypeError, ValueError) as error:
                if not good:
                    found = f"line {number} is none of a log ({error})"
                    raise DataError(f"{path}: {found}: give what --log wrote") from None
                row = {"event": "damaged line", "number": number, "why": error}
            good = True
            yield row


def _checked(row: dict[str, Any]) -> dict[str, Any]:
    """The row itself; raises where it is no event and no position."""
    seconds = row.get("time_s")
    numbers = [0.0 if seconds is None else seconds, row.get("resets", 0)]
    if "event" not in row:
        x, y = row["measurement_m"] if _fit(row) else (0.0, 0.0)
        numbers += [x, y, row["fault"] is None]
    if not all(abs(number) < 1e12 for number in numbers):
        raise ValueError("a number out of range")
    return row


def _fit(row: dict[str, Any]) -> bool:
    """Whether it was fit to be sent to whoever steers by it."""
    return bool(row["observed"] and not row["lost"] and not row["stale"])


def _short(value: object) -> str:
    """Few letters, all of them to be seen: an autopilot's words must not command a terminal."""
    text = shown(str(value), kept="")
    return text if len(text) <= 60 else text[:57] + "..."
