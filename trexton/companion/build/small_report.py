"""The report on a flight: one printable page of HTML that carries everything it shows."""

from __future__ import annotations

import re
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from trexton.base.cache import shipped
from trexton.base.files import atomic_file
from trexton.base.records import Record
from trexton.companion import build
from trexton.companion.build.charts import inline_figure
from trexton.companion.experiments import assessment
from trexton.companion.experiments.advice import advice
from trexton.companion.experiments.drawing import to_svg
from trexton.companion.wording import as_html, distance, middle

__all__ = ["write_report"]


def write_report(record: Record, path: Path, player: str = "") -> Path:
    """Write the report of an `assessment` record to `path`; whole or not at all.

    `player` is the address of a page beside it that plays the test flight.
    """
    with atomic_file(path) as stream:
        stream.write(_page(record, player))
    return path


def _page(record: Record, player: str) -> str:
    counts = record.values["counts"]
    limits = "".join(f"<li>{as_html(sentence)}</li>" for sentence in advice(record))
    title = f"Will it work here? {record.flight}"
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        f'<meta name="viewport" content="width=device-width, initial-scale=1">'
        f"<title>{escape(title)}</title><style>{_style()}</style></head><body>\n"
        f"<h1>{escape(title)}</h1>\n"
        f'<p class="finding">{as_html(assessment.finding(record))}</p>\n'
        f"<h2>What limits it, and what to do</h2><ul>{limits}</ul>\n"
        + _figure(
            assessment.over_the_floor(record),
            "floor",
            "Where the vehicle was, and where the best method thought it was",
            "The error to expect at every place, from the training frames alone, and the test "
            "flight on it.",
        )
        + _figure(
            assessment.error_shares(record),
            "errors",
            "Share of frames below each error, a line for each method",
            "How many frames were off by less than a distance; dashed lines know nothing of the "
            "place.",
        )
        + (
            f'<iframe src="{escape(player)}" title="The test flight, frame by frame"></iframe>'
            if player
            else ""
        )
        + f"<h2>The numbers</h2>{_table(record)}"
        f"<footer><p>{counts['train']} frames to train on, {counts['test']} to test on. 95 % "
        "intervals over "
        f"stretches of the test flight. trexton {escape(_version())}.</p></footer></body></html>\n"
    )


def _style() -> str:
    """With the colours that the book gives to its figures in the dark."""
    book = (shipped("book") / "_static" / "book.css").read_text(encoding="utf-8")
    style = (files(build) / "small_report.css").read_text(encoding="utf-8")
    return style.replace("FIGURE_COLOURS", " ".join(re.findall(r"--fig-\w+: #\w+;", book)))


def _figure(figure: Figure, name: str, alternative: str, caption: str) -> str:
    # Nothing on this page tells the values that the drawing carries.
    svg = re.sub(r"<script.*?</script>", "", to_svg(figure).decode(), flags=re.DOTALL)
    return (
        f"<figure>{inline_figure(svg, name, alternative)}"
        f"<figcaption>{escape(caption)}</figcaption></figure>\n"
    )


def _table(record: Record) -> str:
    errors: dict[str, Any] = record.values["errors"]
    names = {"mean_cm": "mean", "median_cm": "median", "p95_cm": "95 % below"}
    head = "".join(f"<th>{name}</th>" for name in ("", *names.values()))
    rows = "".join(
        f"<tr><td>{escape(assessment.LABELS[name][0])}</td>"
        + "".join(f"<td>{distance(entry[key])}</td>" for key in names)
        + "</tr>"
        for name, entry in sorted(errors.items(), key=lambda one: middle(one[1]["mean_cm"]))
    )
    table = f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
    return f'<div class="scroll" tabindex="0">{table}</div>'


def _version() -> str:
    from trexton import __version__

    return __version__
