"""The ledger as a reader sees it: one table, plain without scripts, with filters where they run.

Offers its tables and its controls as HTML; how they look is in ``ledger.html``.
"""

from __future__ import annotations

from importlib.resources import files
from typing import Any

import jinja2

from trexton.companion import claims
from trexton.companion.claims.ledger import Rows, count_verdicts
from trexton.companion.claims.rules import VERDICTS
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.companion.wording import number
from trexton.flights.registry import flight_title

__all__ = ["claims_html", "counts_html", "filters_html"]


def _read(name: str) -> str:
    return (files(claims) / name).read_text(encoding="utf-8")


def _html(macro: str, *values: Any) -> str:
    environment = jinja2.Environment(autoescape=True)
    environment.filters["number"] = number
    return str(getattr(environment.from_string(_read("ledger.html")).module, macro)(*values))


def _flights(rows: Rows) -> list[str]:
    return [flight_title(flight) for flight in count_verdicts(rows)]


def claims_html(rows: Rows, caption: str = "") -> str:
    """Claims in three columns that never mix: said, printed, tested; then each flight's verdict."""
    return _html("claims", rows, _flights(rows), caption)


def counts_html(rows: Rows, caption: str = "") -> str:
    """How often each verdict was given, a column for each flight."""
    counts = list(count_verdicts(rows).values())
    return _html("counts", counts, VERDICTS, _flights(rows), caption)


def filters_html(rows: Rows) -> str:
    """Controls over the table that follows them."""
    tested = {claim.experiment for claim, _ in rows}
    experiments = [(name, one.title) for name, one in EXPERIMENTS.items() if name in tested]
    verdicts = [(each, each) for each in VERDICTS]
    flights = list(enumerate(_flights(rows)))
    return _html("filters", len(rows), verdicts, flights, experiments, _read("filters.js"))
