"""The README's moving picture and its table of results, made from the results of a book.

``python -m trexton.companion.build.readme`` renews both, and ``data/reference/readme.json``, the
few numbers behind the table with where they come from.
"""

from __future__ import annotations

import base64
import io
import json
import re
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from trexton.base.cache import repository_root
from trexton.base.errors import TrextonError
from trexton.base.files import atomic_file, canonical_json
from trexton.base.records import Record
from trexton.companion.experiments.fine import over_floors
from trexton.companion.experiments.printed import look_up
from trexton.companion.experiments.style import COLORS
from trexton.companion.provenance import kept_results
from trexton.companion.wording import middle, number, percent

__all__ = [
    "door_table",
    "floors",
    "is_current",
    "kept_numbers",
    "moving_picture",
    "results_table",
    "with_table",
]

_KEPT = Path("data") / "reference" / "readme.json"
_PICTURE = Path("book") / "_static" / "flight.webp"
_BEGIN = "<!-- results: python -m trexton.companion.build.readme -->"
_END = "<!-- end of results -->"
_MOST_BYTES = 300_000
_INCHES, _DPI = (6.4, 3.0), 100
_FRAMES = 46
_LASTS_MS = 220
_TRAIL = 12  # frames
_TRUTH = "#1d262d"
_COLORS = tuple(COLORS[name] for name in ("paper", "neighbors", "field"))
_SHOWN = len(_COLORS)  # methods: the first, its neighbours alone, the last
_FLIGHT = "cyberzoo"
# label: experiment and place of the mean error, and of the share that the 90 % region covers
_ROWS: dict[str, tuple[tuple[str, str], ...]] = {
    "the paper's filter": (("mocap_training", "filter.mean_cm"),),
    "its neighbours alone": (("mocap_training", "knn.mean_cm"),),
    "`field`": (("beyond", "field.mean_cm"), ("beyond", "field.held")),
}
# The same of the long runs over ten floors, which are kept with the code.
_FLOORS = {
    "the paper's filter": ("aiding", "error_cm.paper.nothing"),
    "`field`": ("aiding", "error_cm.field.nothing"),
    "`field`, with a velocity": ("aiding", "error_cm.field.velocity"),
}
_FINE = "`fine`, which registers images"


def kept_numbers(results: Path) -> dict[str, Any]:
    """The numbers of the table, and the provenance of the records that they are from.

    Raises
    ------
    TrextonError
        There are no results of the real flight.
    """
    records = {
        name: Record.load(path)
        for name in ("mocap_training", "beyond")
        if (path := results / _FLIGHT / f"{name}.json").is_file()
    }
    rows = {
        label: _row(*(look_up(records[name].values, key) for name, key in places))
        for label, places in _ROWS.items()
        if all(name in records for name, _ in places)
    }
    if not rows:
        raise TrextonError(f"{results}: no records of {_FLIGHT}: make book first")
    sources = {
        name: {"parameters": each.parameters, "provenance": each.provenance}
        for name, each in records.items()
    }
    return {_FLIGHT: {"rows": rows, "from": sources}, "floors": floors()}


def floors() -> dict[str, Any]:
    """Mean errors over the floors of the kept long runs, with intervals over floors."""
    kept = [path for path in kept_results() if path.stem in ("aiding", "fine")]
    records = {path.stem: Record.load(path) for path in kept}
    rows = {
        label: _row(look_up(records[name].values, key))
        for label, (name, key) in _FLOORS.items()
        if name in records
    }
    if "fine" in records:
        rows[_FINE] = _row(over_floors(records["fine"], "free", "mean_cm"))
    return {"rows": rows, "from": [f"data/reference/{name}.json" for name in records]}


def _row(error: Any, held: Any = None) -> dict[str, float]:
    row = {"cm": middle(error), "low": error["low"], "high": error["high"]}
    return row if held is None else row | {"held": middle(held)}


def results_table(flights: Mapping[str, Any]) -> str:
    """The table as Markdown: a row a method, a column a kind of floor."""
    heads = {
        "floors": "ten simulated floors",
        _FLIGHT: "the authors' real flight (0.39 times as much if its unit is 1/256 m)",
    }
    lines = [["mean error", *heads.values()], ["---"] * (1 + len(heads))]
    labels = [*_ROWS, *(label for label in flights["floors"]["rows"] if label not in _ROWS)]
    lines += [[label, *(_cell(flights[name]["rows"].get(label)) for name in heads)]
              for label in labels]  # fmt: skip
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def door_table(results: Path) -> str:
    """The table made of these results; nothing where they have not the real flight."""
    try:
        return results_table(kept_numbers(results))
    except TrextonError:
        return ""


def _cell(row: Mapping[str, float] | None) -> str:
    if row is None:
        return ""
    text = f"{number(row['cm'])} cm [{number(row['low'])}, {number(row['high'])}]"
    return text + (f", 90 % region covers {percent(row['held'])}" if "held" in row else "")


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


def moving_picture(recording: Mapping[str, Any]) -> bytes:
    """An animated WebP of a recording.

    Parameters
    ----------
    recording : mapping
        As the player keeps it: see `trexton.companion.player.playback.PlayedFlight`.
    """
    frames = recording["frames"]
    frames = frames[:: -(-len(frames) // _FRAMES)]
    names = list(frames[0]["estimates_cm"])
    names = [*names[: _SHOWN - 1], names[-1]] if len(names) > _SHOWN else names
    drawn = [_drawn(recording, frames[: i + 1], names) for i in range(len(frames))]
    stream = io.BytesIO()
    drawn[0].save(
        stream, "WEBP", save_all=True, append_images=drawn[1:], duration=_LASTS_MS, loop=0,
        quality=30, method=4,
    )  # fmt: skip
    return stream.getvalue()


def _decoded(uri: str) -> np.ndarray:
    return np.asarray(Image.open(io.BytesIO(base64.b64decode(uri.partition(",")[2]))))


def _drawn(recording: Mapping[str, Any], frames: list[Any], names: list[str]) -> Image.Image:
    """The last of `frames`: the camera and the errors to the left, the floor to the right."""
    figure, now = Figure(_INCHES), frames[-1]
    camera = figure.add_axes((0.02, 0.46, 0.31, 0.5))
    floor = figure.add_axes((0.36, 0.04, 0.62, 0.92))
    for axes in (camera, floor):
        axes.set_axis_off()
    if now["image"]:
        camera.imshow(_decoded(now["image"]))
    if recording["floor"]:
        extent = recording["floor"]["extent_m"]
        floor.imshow(_decoded(recording["floor"]["image"]), extent=extent, alpha=0.5)
    x_min, x_max, y_min, y_max = recording["area"]
    floor.set(xlim=(x_min, x_max), ylim=(y_min, y_max), aspect="equal")
    trail = np.array([each["truth_cm"] for each in frames[-_TRAIL:]], dtype=float) / 100
    floor.plot(*trail.T, color=_TRUTH)
    if now["particles_cm"]:
        particles = np.array(now["particles_cm"], dtype=float) / 100
        floor.plot(*particles.T, ".", color=COLORS["particles"], markersize=2)
    figure.text(0.02, 0.38, f"{now['time_s']:.0f} s; off by", color=_TRUTH)
    for row, (name, color) in enumerate(zip(names, _COLORS, strict=False)):
        place = np.array(now["estimates_cm"][name] or (np.nan, np.nan), dtype=float) / 100
        floor.plot(*place, "o", color=color)
        error = now["errors_cm"][name]
        said = "unknown" if error is None else f"{error} cm"
        figure.text(0.02, 0.3 - 0.08 * row, f"● {name}: {said}", color=color)
    floor.plot(*trail[-1], "o", color=_TRUTH, markersize=9, fillstyle="none", markeredgewidth=2)
    figure.text(0.02, 0.3 - 0.08 * len(names), "○ the truth", color=_TRUTH)
    stream = io.BytesIO()
    figure.savefig(stream, dpi=_DPI)
    return Image.open(stream).convert("RGB")


def main(root: Path, results: Path) -> None:
    """Renew numbers, table and picture of the clone at `root`."""
    flights = kept_numbers(results)
    players = (results / name / "mocap_training-player.html" for name in ("sim-survey", _FLIGHT))
    player = next(filter(Path.is_file, players), None)
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
