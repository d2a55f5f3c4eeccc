"""The paper map: every table, figure and claim of the paper, its page here, theirs beside ours."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

from trexton.base.errors import ParameterError
from trexton.base.records import Record
from trexton.companion.claims.ledger import Claim, Finding, judge_all, load_claims
from trexton.companion.experiments.printed import paper_file
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.companion.wording import number
from trexton.flights.registry import flight_title

__all__ = ["Item", "load_map", "map_table"]


_PROSE = {"method": "The method", "ambiguities": "What is open", "run_again": "Run it again"}


@dataclass(frozen=True)
class Item:
    """Something that the paper shows or claims: its name, the page here, ids of its claims."""

    name: str
    page: str
    claims: Sequence[str]


def load_map(path: Path | None = None) -> list[Item]:
    """All items, in the order of the paper; raises `ParameterError` unless each claim is in one."""
    path = path or paper_file("map.toml")
    items = [Item(**table) for table in tomllib.loads(path.read_text(encoding="utf-8"))["item"]]
    named = [claim for item in items for claim in item.claims]
    declared = {claim.id for claim in load_claims(paper_file("claims.toml"))}
    wrong = sorted(
        {n for n in named if named.count(n) > 1 or n not in declared} | (declared - set(named))
    )
    if wrong:
        raise ParameterError(
            f"{path}: {', '.join(wrong)}: expected every claim of claims.toml in one item, once"
        )
    return items


def map_table(records: dict[str, dict[str, Record]], see: Callable[[str, str], str]) -> str:
    """The map as a Markdown table.

    Parameters
    ----------
    records : dict
        By flight and experiment.
    see : callable
        ``see(name, text)``: a link to a page or an experiment, or plain text where there is none.
    """
    flights = sorted(records)
    rows = {claim.id: (claim, findings) for claim, findings in judge_all(records)}
    heads = ["In the paper", "Here", "It printed", *(flight_title(flight) for flight in flights)]
    lines = [" | ".join(heads), " | ".join("---" for _ in heads)]
    for item in load_map():
        own = [rows[name] for name in item.claims]
        cells = [item.name, see(item.page, _title(item.page)), _printed([c for c, _ in own])]
        cells += [_ours([(c, findings[i]) for c, findings in own]) for i in range(len(flights))]
        lines.append(" | ".join(cells))
    return "\n".join(f"| {line} |" for line in lines)


def _title(page: str) -> str:
    return EXPERIMENTS[page].title if page in EXPERIMENTS else _PROSE.get(page, page)


def _grouped(parts: Sequence[tuple[str, str]], unit: str) -> str:
    """Numbers of one unit, joined: ``31, 59 cm``."""
    return ", ".join(text for text, _ in parts) + (f" {unit}" if unit else "")


def _named(claim: Claim, value: str, several: bool) -> str:
    """A number, with the claim's name (and its words, to be pointed at) where others stand beside
    it.
    """
    words = claim.label or claim.id.replace("-", " ")
    name = f'<abbr title="{escape(claim.text)}">{escape(words)}</abbr>'
    return f"{name} {value}" if several else value


def _printed(claims: Sequence[Claim]) -> str:
    printed = [
        (_named(c, number(c.printed_value), len(claims) > 1), c.unit)
        for c in claims
        if c.printed_value is not None
    ]
    units = list(dict.fromkeys(unit for _, unit in printed))
    return "; ".join(_grouped([part for part in printed if part[1] == u], u) for u in units)


def _ours(findings: Sequence[tuple[Claim, Finding]]) -> str:
    """What one flight gave: numbers under each verdict, in the order of the claims."""
    verdicts = list(dict.fromkeys(finding.verdict for _, finding in findings))
    cells = []
    for verdict in verdicts:
        texts = []
        for claim, finding in findings:
            if finding.verdict == verdict and finding.ours is not None:
                pair = [finding.ours, *([finding.other] if finding.other else [])]
                values = " against ".join(number(each.value) for each in pair)
                texts.append((_named(claim, values, len(findings) > 1), claim.unit))
        units = list(dict.fromkeys(unit for _, unit in texts))
        numbers = "; ".join(_grouped([t for t in texts if t[1] == u], u) for u in units)
        badge = f'<span class="verdict {verdict.replace(" ", "-")}">{verdict}</span>'
        cells.append(f"{numbers} {badge}".strip())
    return "<br>".join(cells)
