"""The ledger as a reader sees it: one table, plain without scripts, with filters where they run."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from importlib.resources import files

from trexton.companion import claims
from trexton.companion.claims.ledger import Claim, Finding, Rows, count_verdicts
from trexton.companion.claims.rules import VERDICTS, Quantity
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.companion.wording import number
from trexton.flights.registry import flight_title

__all__ = ["claims_html", "counts_html", "filters_html", "quantities"]


def _span(quantity: Quantity) -> str:
    if quantity.low == quantity.high:
        return number(quantity.value)
    interval = f"[{number(quantity.low)}, {number(quantity.high)}]"
    return f"{number(quantity.value)} <small>{interval}</small>"


def quantities(finding: Finding, unit: str) -> str:
    """Our side of a claim as HTML; empty where nothing was measured."""
    spans = [_span(each) for each in (finding.ours, finding.other) if each is not None]
    return f"{' against '.join(spans)} {escape(unit)}".strip() if spans else ""


def _verdict(finding: Finding) -> str:
    name = finding.verdict.replace(" ", "-")
    badge = f'<span class="verdict {name}">{finding.verdict}</span>'
    return badge + (f"<br><small>{escape(finding.reason)}</small>" if finding.reason else "")


def _cell(label: str, content: str) -> str:
    return f'<td data-label="{escape(label)}">{content}</td>'


def _test(claim: Claim) -> str:
    """Our test of a claim; a phone folds it, and with it all but the claim and its verdicts."""
    small = f"<br><small>{escape(claim.rule)}</small>" if claim.rule else ""
    handle = f'<summary aria-label="Test and numbers: {escape(claim.text)}"></summary>'
    words = f"{escape(claim.measure)}{small}" if claim.measure else ""
    return f'<details class="fold" open>{handle}{words}</details>' if words else ""


def _row(claim: Claim, findings: list[Finding]) -> str:
    printed = "" if claim.printed_value is None else number(claim.printed_value)
    cells = [
        _cell("The paper says", f"{escape(claim.text)}<br><small>{escape(claim.place)}</small>"),
        _cell("It printed", f"{printed} {escape(claim.unit)}".rstrip() if printed else ""),
        _cell("Our test", _test(claim)),
    ]
    for finding in findings:
        measured = quantities(finding, claim.unit)
        content = (f"<span>{measured}</span><br>" if measured else "") + _verdict(finding)
        cells.append(_cell(flight_title(finding.flight), content))
    verdicts = "|".join(finding.verdict for finding in findings)
    return (
        f'<tr id="claim-{claim.id}" data-experiment="{claim.experiment}" '
        f'data-verdicts="{verdicts}">{"".join(cells)}</tr>'
    )


def _table(kind: str, caption: str, heads: Iterable[str], rows: Iterable[str]) -> str:
    said = f"<caption>{escape(caption)}</caption>" if caption else ""
    head = "".join(f'<th scope="col">{escape(each)}</th>' for each in heads)
    body = "\n".join(rows)
    return (
        f'<table class="table {kind}">{said}<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n'
        "</tbody></table>"
    )


def claims_html(rows: Rows, caption: str = "") -> str:
    """Claims in three columns that never mix: said, printed, tested; then each flight's verdict."""
    flights = [flight_title(flight) for flight in count_verdicts(rows)]
    heads = ["The paper says", "It printed", "Our test", *flights]
    return _table("ledger stacked", caption, heads, (_row(*row) for row in rows))


def counts_html(rows: Rows, caption: str = "") -> str:
    """How often each verdict was given, a column for each flight."""
    counts = count_verdicts(rows)
    lines = (
        f'<tr><th scope="row"><span class="verdict {name.replace(" ", "-")}">{name}</span></th>'
        + "".join(f"<td>{own[name]}</td>" for own in counts.values())
        + "</tr>"
        for name in VERDICTS
    )
    return _table("counts", caption, ["Verdict", *map(flight_title, counts)], lines)


def _select(name: str, title: str, options: list[tuple[str, str]]) -> str:
    every = [("", "all"), *options]
    choices = "".join(f'<option value="{escape(v)}">{escape(t)}</option>' for v, t in every)
    return f'<label>{title} <select data-filter="{name}">{choices}</select></label>'


def filters_html(rows: Rows) -> str:
    """Controls over the table that follows them; hidden until the script that serves them runs."""
    flights = count_verdicts(rows)
    tested = {claim.experiment for claim, _ in rows}
    experiments = [(n, e.title) for n, e in EXPERIMENTS.items() if n in tested]
    controls = [
        _select("verdict", "Verdict", [(each, each) for each in VERDICTS]),
        _select("flight", "on", [(str(i), flight_title(f)) for i, f in enumerate(flights)]),
        _select("experiment", "tested by", experiments),
        '<label>with the words <input type="search" data-filter="words"></label>',
        f'<output aria-live="polite">{len(rows)} of {len(rows)} claims</output>',
    ]
    script = f"<script>\n{(files(claims) / 'filters.js').read_text(encoding='utf-8')}</script>"
    return f'<form class="ledger-filters" hidden>{" ".join(controls)}</form>\n{script}'
