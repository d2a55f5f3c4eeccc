"""The ledger as a reader sees it, and the paper item by item, its numbers beside ours.

Offers tables and controls of the ledger as HTML, plain without scripts (how they look is in
``ledger.html``), and the map of the paper as Markdown.
"""

from collections.abc import Callable
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import Any, NamedTuple

import jinja2

from trexton.base.cache import shipped
from trexton.base.errors import ParameterError
from trexton.base.files import read_toml
from trexton.base.records import Record
from trexton.companion import claims
from trexton.companion.claims.ledger import (
    Claim,
    Finding,
    Rows,
    count_verdicts,
    judge_all,
    load_claims,
)
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
    flights = sorted(records)
    rows = {claim.id: (claim, findings) for claim, findings in judge_all(records)}
    lines = [["In the paper", "Here", "Printed", *map(flight_title, flights)]]
    lines.append(["---"] * len(lines[0]))
    for item in load_map():
        own = [rows[name] for name in item.claims]
        named = len(own) > 1
        printed = [
            _valued(claim, number(claim.printed_value), named)
            for claim, _ in own
            if claim.printed_value is not None
        ]
        prose = shipped("book") / f"{item.page}.md"
        known = EXPERIMENTS.get(item.page)
        page = known.title if known else prose.read_text("utf-8").partition("\n")[0][2:]
        line = [item.name, see(item.page, page), "; ".join(printed)]
        for index in range(len(flights)):
            line.append("<br>".join(_judged(claim, found[index], named) for claim, found in own))
        lines.append(line)
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _valued(claim: Claim, value: str, named: bool) -> str:
    """A number with its unit; beside others its name too, and its words to be pointed at."""
    words = claim.label or claim.measure or claim.text
    if words.startswith("the same"):  # of an item that says as what
        words = claim.text.rpartition(", ")[2]
    name = f'<abbr title="{escape(claim.text)}">{escape(words)}</abbr> ' if named else ""
    return f"{name}{value} {claim.unit}".strip()


def _judged(claim: Claim, finding: Finding, named: bool) -> str:
    badge = f'<span class="verdict {finding.verdict.replace(" ", "-")}">{finding.verdict}</span>'
    values = [number(each.value) for each in (finding.ours, finding.other) if each]
    return f"{_valued(claim, ' against '.join(values), named)} {badge}" if values else badge
