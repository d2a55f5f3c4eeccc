"""The README's moving picture and its table of results, made from the results of a book.

``python -m trexton.companion.build.readme`` renews both, and ``data/reference/readme.json``, the
few numbers behind the table with where they come from.
"""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.cache import repository_root
from trexton.base.errors import TrextonError
from trexton.base.files import atomic_file, canonical_json
from trexton.base.records import Record
from trexton.companion.build.headlines import PLACES
from trexton.companion.experiments.printed import look_up
from trexton.companion.wording import middle, number, percent
from trexton.evaluation.metrics import mean_over_groups

__all__ = ["is_current", "kept_numbers", "results_table", "with_table"]

_KEPT = Path("data") / "reference" / "readme.json"
_PICTURE = Path("book") / "_static" / "flight.webp"
_BEGIN, _END = (
    "<!-- results: python -m trexton.companion.build.readme -->",
    "<!-- end of results -->",
)
_MOST_BYTES = 300_000
_FLOORS = Path("data") / "reference" / "sweep-suitability.json"  # a long run, kept with the code
_OVER_FLOORS = {
    "the paper's filter": "mean.paper_cm",
    "`field`, beyond the paper": "mean.field_cm",
}
# label: experiment, mean distance to the truth, share of frames that the 90 % region holds
_ROWS: dict[str, tuple[str, str, tuple[str, str] | None]] = {
    "the paper's filter": ("mocap_training", "filter.mean_cm", ("beyond", "paper.held")),
    "its neighbours alone": ("mocap_training", "knn.mean_cm", None),
    "`field`, beyond the paper": ("beyond", "field.mean_cm", ("beyond", "field.held")),
    "`field`, with odometry": (
        "beyond",
        "field_camera.mean_cm",
        ("beyond", "field_camera.held"),
    ),
    "`fine`, which compares images": ("fine", "flight.stitched.free.mean_cm", None),
}


def kept_numbers(results: Path) -> dict[str, Any]:
    """The numbers of the table, and the provenance of the records that they are from.

    Raises
    ------
    TrextonError
        There are no results of either flight.
    """
    flights: dict[str, Any] = {}
    for flight in PLACES:
        records = {
            path.stem: Record.load(path)
            for path in sorted((results / flight).glob("*.json"))
            if path.stem in {"mocap_training", "beyond", "fine"}
        }
        rows = {label: _row(records, *place) for label, place in _ROWS.items()}
        if rows := {label: row for label, row in rows.items() if row}:
            flights[flight] = {
                "rows": rows,
                "from": {
                    name: {"parameters": each.parameters, "provenance": each.provenance}
                    for name, each in records.items()
                },
            }
    if not flights:
        raise TrextonError(f"{results}: no records of {', '.join(PLACES)}: make book first")
    return flights | _over_floors()


def _over_floors() -> dict[str, Any]:
    """Means over the floors of the kept sweep, with intervals over floors; {} without a clone."""
    root = repository_root()
    if root is None:
        return {}
    kept = json.loads((root / _FLOORS).read_text("utf-8"))["rows"]
    rows = {}
    for label, key in _OVER_FLOORS.items():
        mean = mean_over_groups(np.array([row[key] for row in kept]), 0.0, np.inf)
        rows[label] = {"cm": mean["value"], "low": mean["low"], "high": mean["high"]}
    return {"floors": {"rows": rows, "count": len(kept), "from": _FLOORS.as_posix()}}


def _row(
    records: Mapping[str, Record], experiment: str, place: str, held: tuple[str, str] | None
) -> dict[str, Any] | None:
    entry = _value(records, experiment, place)
    if entry is None:
        return None
    row = {"cm": middle(entry)}
    if isinstance(entry, dict):
        row |= {"low": entry["low"], "high": entry["high"]}
    share = _value(records, *held) if held else None
    return row if share is None else row | {"held": middle(share)}


def _value(records: Mapping[str, Record], experiment: str, place: str) -> Any:
    return look_up(records[experiment].values, place) if experiment in records else None


def results_table(flights: Mapping[str, Any]) -> str:
    """The table as Markdown: a row a method, a column a flight."""
    names = dict(PLACES)
    if floors := flights.get("floors"):
        names["floors"] = f"over {floors['count']} floors, simulated"
    columns = {name: flights[name]["rows"] for name in names if name in flights}
    heads = ["mean distance to the truth", *(names[name] for name in columns)]
    lines = [heads, ["---"] * len(heads)]
    for label in _ROWS:
        cells = [_cell(rows.get(label)) for rows in columns.values()]
        if any(cells):
            lines.append([label, *cells])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _cell(row: Mapping[str, float] | None) -> str:
    if row is None:
        return ""
    text = f"{number(row['cm'])} cm"
    if "low" in row:
        text += f" [{number(row['low'])}, {number(row['high'])}]"
    return text + (f", 90 % region holds {percent(row['held'])}" if "held" in row else "")


def with_table(text: str, table: str) -> str:
    """The README's text with this table between its two marks.

    Raises
    ------
    TrextonError
        The marks are not there, once each.
    """
    if text.count(_BEGIN) != 1 or text.count(_END) != 1:
        raise TrextonError(f"README.md: expected {_BEGIN} and {_END} once each: put them back")
    head, _, rest = text.partition(_BEGIN)
    return f"{head}{_BEGIN}\n{table}\n{_END}{rest.partition(_END)[2]}"


def is_current(readme: Path, results: Path) -> bool:
    """Whether the README's table has the numbers of these results; True where there are none."""
    try:
        text = readme.read_text(encoding="utf-8")
        return with_table(text, results_table(kept_numbers(results))) == text
    except (OSError, TrextonError):
        return True


def main(root: Path, results: Path) -> None:
    """Renew numbers, table and picture of the clone at `root`."""
    from trexton.companion.build.animation import moving_picture

    flights = kept_numbers(results)
    player = next(
        (
            p
            for f in reversed(PLACES)
            if (p := results / f / "mocap_training-player.html").is_file()
        ),
        None,
    )
    if player is None:
        raise TrextonError(f"{results}: no player of mocap_training: make book first")
    data = re.search(r'type="application/json">(.*?)</script>', player.read_text("utf-8"), re.S)
    assert data is not None
    picture = moving_picture(json.loads(data[1]))
    if len(picture) > _MOST_BYTES:
        raise TrextonError(f"the moving picture has {len(picture)} bytes: {_MOST_BYTES} at most")
    text = with_table((root / "README.md").read_text("utf-8"), results_table(flights))
    for path, content in (
        (root / _KEPT, canonical_json(flights).encode()),
        (root / _PICTURE, picture),
        (root / "README.md", text.encode()),
    ):
        with atomic_file(path, "wb") as stream:
            stream.write(content)
        print(f"{path}: {len(content):,} bytes")


if __name__ == "__main__":
    clone = repository_root() or Path(".")
    main(clone, Path(sys.argv[1]) if len(sys.argv) > 1 else clone / "results")
