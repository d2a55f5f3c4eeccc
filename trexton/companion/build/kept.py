"""Results of runs too long for every book, kept with the code. Offers `reference`, a record, and
`swept`, a table; where other code made it than stands here, the page says so.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

from IPython.display import HTML, display

from trexton.base.records import Record
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.companion.provenance import kept_results, made_by

__all__ = ["reference", "swept"]


def reference(experiment: str) -> Record | None:
    """The record of a run too long for every book, kept with the code; None where there is none."""
    path = _kept(experiment)
    if path is None:
        return None
    record = Record.load(path)
    _say_if_stale(experiment, record.experiment, record.provenance)
    return record


def swept(plan: str) -> dict[str, Any] | None:
    """The table of a plan in ``data/sweeps``, kept with the code; None where there is none."""
    path = _kept(f"sweep-{plan}")
    if path is None:
        return None
    table: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    _say_if_stale(path.stem, table["experiment"], table)
    return table


def _say_if_stale(name: str, experiment: str, made: Mapping[str, Any]) -> None:
    """On the page, where a kept result was made by other code than stands here."""
    if made.get("code") != made_by(EXPERIMENTS[experiment].module)["code"]:
        at = f"commit {made['commit'][:12]}" if "commit" in made else "a commit it does not name"
        display(
            HTML(
                f'<p class="stale">The kept result {escape(name)} was made by other code, at {at}. '
                "<code>make full</code> renews it.</p>"
            )
        )


def _kept(name: str) -> Path | None:
    return next((path for path in kept_results() if path.stem == name), None)
