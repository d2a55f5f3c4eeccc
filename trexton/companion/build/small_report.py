"""The report on a flight. It is one printable page of HTML that carries everything it shows."""

import re
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from trexton import __version__
from trexton.base.cache import shipped
from trexton.base.files import write_file
from trexton.base.records import Record
from trexton.companion import build
from trexton.companion.build.charts import inline_figure, with_phone
from trexton.companion.experiments import advice, assessment
from trexton.companion.experiments.figure_files import for_phones, to_svg
from trexton.companion.wording import as_html, middle, template_environment


def write_report(
    record: Record, path: Path, player: str = "", flight: str = "", doubts: Sequence[str] = ()
) -> Path:
    """Write the report of an `assessment` record to `path`; whole or not at all.

    `player` is the address of a page beside it that plays the test flight, `flight` the folder
    that its commands name, `doubts` what its check warns of.
    """
    captions = {
        "floor": "The error to expect at every place, from the training frames alone, and the test "
        "flight on it.",
        "errors": "How many frames were off by less than a distance; dashed lines know nothing of "
        "the place.",
    }
    figures = assessment.over_the_floor(record), assessment.error_shares(record)
    sections = {
        "Mend the flight first (trexton check --repair)": doubts,
        "Where it fails": advice.where_it_fails(record),
        "What limits it": advice.what_limits(record),
        "What to do next": advice.what_next(record, flight),
    }
    # With the colours that the book gives to its figures in the dark.
    book = (shipped("book") / "_static" / "book.css").read_text(encoding="utf-8")
    style = (files(build) / "small_report.css").read_text(encoding="utf-8")
    template = (files(build) / "small_report.html").read_text(encoding="utf-8")
    page = template_environment().from_string(template)
    text = page.render(
        title=f"Will it work here? {record.flight}",
        style=style.replace("FIGURE_COLOURS", " ".join(re.findall(r"--fig-\w+: #\w+;", book))),
        finding=as_html(assessment.finding(record)),
        sections=[(title, list(map(as_html, said))) for title, said in sections.items()],
        commands=[command for command in advice.commands(record, flight) if command],
        figures=[
            (inline_figure(with_phone(svg, for_phones(figure)), name, caption), caption)
            for figure, (name, caption) in zip(figures, captions.items(), strict=True)
            if (svg := to_svg(figure).decode())
        ],
        player=player,
        rows=_rows(record),
        counts=record.values["counts"],
        version=__version__,
    )
    write_file(path, text)
    return path


def _rows(record: Record) -> list[list[str]]:
    """Name, mean, median and 95th percentile of each method, the best first."""
    errors: dict[str, Any] = record.values["errors"]
    say = advice.lengths_of(record)
    return [
        [assessment.label_of(name)[0]]
        + [say(entry[key]) for key in ("mean_cm", "median_cm", "p95_cm")]
        for name, entry in sorted(errors.items(), key=lambda one: middle(one[1]["mean_cm"]))
    ]
