"""The ledger as a reader sees it, and the paper item by item, its numbers beside ours.

Offers tables and controls of the ledger as HTML, plain without scripts, and the map of the paper as
Markdown; how they look is in ``ledger.html``.
"""

from collections.abc import Callable
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import jinja2

from trexton.base.cache import shipped
from trexton.base.errors import ParameterError
from trexton.base.files import read_toml
from trexton.base.records import Record
from trexton.companion import claims
from trexton.companion.claims.ledger import Rows, count_verdicts, judge_all, load_claims
from trexton.companion.claims.rules import VERDICTS
from trexton.companion.experiments.printed import paper_file
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.companion.wording import flight_title, number


def _html(macro: str, *values: Any) -> str:
    environment = jinja2.Environment(autoescape=True)
    environment.filters["number"] = number
    template = environment.from_string((files(claims) / "ledger.html").read_text("utf-8"))
    return str(getattr(template.module, macro)(*values))


def _flights(rows: Rows) -> list[str]:
    return [flight_title(flight) for flight in count_verdicts(rows)]


def claims_html(rows: Rows, caption: str = "") -> str:
    """Claims in three columns that never mix: said, printed, tested; then each flight's verdict."""
    flights, data = _flights(rows), {claim.data for claim, _ in rows}
    heads = [*data] * len(flights) if len(data) == 1 and all(data) else flights
    return _html("claims", rows, heads, caption)


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
    script = (files(claims) / "filters.js").read_text("utf-8")
    return _html("filters", len(rows), verdicts, flights, experiments, script)


class Item(NamedTuple):
    """Something that the paper shows or claims: its name, the page here, ids of its claims."""

    name: str
    page: str
    claims: list[str]


def load_map(path: Path | None = None) -> list[Item]:
    """All items, in the order of the paper; raises `ParameterError` unless each claim is in one."""
    path = path or paper_file("map.toml")
    items = [Item(**table) for table in read_toml(path)["item"]]
    named = [claim for item in items for claim in item.claims]
    declared = [claim.id for claim in load_claims(paper_file("claims.toml"))]
    if sorted(named) != sorted(declared):
        wrong = sorted({n for n in named + declared if named.count(n) != 1 or n not in declared})
        raise ParameterError(
            f"{path}: {', '.join(wrong)}: expected every claim of claims.toml in one item, once"
        )
    return items


def map_table(records: dict[str, dict[str, Record]], see: Callable[[str, str], str]) -> str:
    """Every item of the paper, its page here, theirs beside ours, as a Markdown table.

    Parameters
    ----------
    records : dict
        By flight and experiment.
    see : callable
        ``see(name, text)``: a link to a page or an experiment, or plain text where there is none.
    """
    rows = {claim.id: (claim, findings) for claim, findings in judge_all(records)}
    lines = []
    for item in load_map():
        prose = shipped("book") / f"{item.page}.md"
        known = EXPERIMENTS.get(item.page)
        page = known.title if known else prose.read_text("utf-8").partition("\n")[0][2:]
        lines.append((item.name, see(item.page, page), [rows[name] for name in item.claims]))
    return _html("paper", lines, list(map(flight_title, sorted(records))))
