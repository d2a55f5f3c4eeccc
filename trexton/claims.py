"""The ledger: every claim of the paper, its published value, ours, and a verdict under a rule fixed beforehand.

A claim is one table of ``data/paper/claims.toml``. Its `kind` names the rule:

``value``
    *reproduced* if the published value lies in our 95 % interval or within a quarter of ours; *in direction* if the two
    are within a factor of two; else *not reproduced*.
``below``
    Ours should be at most the published bound: *reproduced* if our whole interval is, *in direction* if our value is.
``above``
    The same with at least.
``order``
    `less` should be smaller than `greater`: *reproduced* if the intervals do not overlap, *in direction* if the values
    stand in that order.
``exact``
    Equal or not.
``untestable``
    Not testable here, for the `reason` given; what we measured may stand beside it.
"""

from __future__ import annotations

import tomllib
from dataclasses import asdict, dataclass
from pathlib import Path

from trexton.errors import ParameterError, TrextonError
from trexton.files import atomic_file, canonical_json
from trexton.paper import look_up, paper_file, published
from trexton.records import Record, plain

__all__ = [
    "Claim",
    "Finding",
    "Quantity",
    "VERDICTS",
    "count_verdicts",
    "judge",
    "judge_all",
    "load_claims",
    "load_records",
    "write_ledger",
]

REPRODUCED, DIRECTION, FAILED, UNTESTABLE = VERDICTS = (
    "reproduced", "reproduced in direction", "not reproduced", "not testable here",
)  # fmt: skip
TOLERANCE, FACTOR = 0.25, 2.0
SCHEMA = 1
_KINDS = ("value", "below", "above", "order", "exact", "untestable")


@dataclass(frozen=True)
class Claim:
    """One claim: `ours`, `less` and `greater` are ``experiment:path`` into a record's values (or timings)."""

    id: str
    place: str
    text: str
    kind: str
    experiment: str
    published: str | float | None = None
    unit: str = ""
    ours: str | None = None
    less: str | None = None
    greater: str | None = None
    reason: str = ""

    def __post_init__(self):
        if self.kind not in _KINDS:
            raise ParameterError(
                f"claim {self.id!r} has kind {self.kind!r}: expected one of {', '.join(_KINDS)}"
            )

    @property
    def published_value(self) -> float | None:
        """The number itself, looked up where `published` is a path."""
        if not isinstance(self.published, str):
            return self.published
        value = look_up(published(), self.published)
        if value is None:
            raise ParameterError(
                f"claim {self.id!r} names {self.published!r}, which data/paper/published.toml does not have"
            )
        return value


@dataclass(frozen=True)
class Quantity:
    """A value and its 95 % interval (equal to the value where none is known)."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Finding:
    """What one flight says about a claim."""

    flight: str
    verdict: str
    ours: Quantity | None = None
    other: Quantity | None = None
    reason: str = ""


def load_claims(path: Path | None = None) -> list[Claim]:
    """All claims, in the order of the paper."""
    path = path or paper_file("claims.toml")
    return [Claim(**table) for table in tomllib.loads(path.read_text(encoding="utf-8"))["claim"]]


def load_records(folder: Path) -> dict[str, dict[str, Record]]:
    """Records below `folder`, by flight and experiment."""
    records: dict[str, dict[str, Record]] = {}
    for path in sorted(Path(folder).glob("*/*.json")):
        if not path.name.startswith((".", "claims")):
            record = Record.load(path)
            records.setdefault(record.flight, {})[record.experiment] = record
    return records


def _quantity(reference: str, records: dict[str, Record]) -> Quantity | None:
    experiment, _, path = reference.partition(":")
    if experiment not in records:
        return None
    record = records[experiment]
    found = look_up(record.values, path)
    if found is None:
        found = look_up(record.timings, path)
    if isinstance(found, dict):
        value = found.get("median", found.get("value"))
        if value is None:
            return None
        return Quantity(
            value, *(found[key] if found.get(key) is not None else value for key in ("low", "high"))
        )
    return None if found is None else Quantity(found, found, found)


def judge(claim: Claim, records: dict[str, Record], flight: str = "") -> Finding:
    """The verdict of one flight's records on one claim."""
    references = [reference for reference in (claim.ours, claim.less, claim.greater) if reference]
    quantities = [_quantity(reference, records) for reference in references]
    first, second = (quantities + [None, None])[:2]
    if claim.kind == "untestable":
        return Finding(flight, UNTESTABLE, first, second, claim.reason)
    missing = [reference for reference, quantity in zip(references, quantities) if quantity is None]
    if missing:
        return Finding(
            flight, UNTESTABLE, first, second, f"this flight has no {missing[0].replace(':', ' ')}"
        )
    rule = {"value": _close, "below": _below, "above": _above, "exact": _equal}
    verdict = (
        _ordered(first, second)
        if claim.kind == "order"
        else rule[claim.kind](first, claim.published_value)
    )
    return Finding(flight, verdict, first, second)


def _close(ours: Quantity, target: float) -> str:
    if ours.low <= target <= ours.high or abs(ours.value - target) <= TOLERANCE * abs(ours.value):
        return REPRODUCED
    same_sign = ours.value * target > 0
    return DIRECTION if same_sign and 1 / FACTOR <= ours.value / target <= FACTOR else FAILED


def _below(ours: Quantity, bound: float) -> str:
    return REPRODUCED if ours.high <= bound else DIRECTION if ours.value <= bound else FAILED


def _above(ours: Quantity, bound: float) -> str:
    return REPRODUCED if ours.low >= bound else DIRECTION if ours.value >= bound else FAILED


def _equal(ours: Quantity, target: float) -> str:
    return REPRODUCED if ours.value == target else FAILED


def _ordered(less: Quantity, greater: Quantity) -> str:
    return (
        REPRODUCED
        if less.high < greater.low
        else DIRECTION
        if less.value < greater.value
        else FAILED
    )


def judge_all(
    records: dict[str, dict[str, Record]], claims: list[Claim] | None = None
) -> list[tuple[Claim, list[Finding]]]:
    """Every claim, in the order of the paper, with its finding on each flight."""
    claims = load_claims() if claims is None else claims
    return [
        (claim, [judge(claim, records[flight], flight) for flight in sorted(records)])
        for claim in claims
    ]


def count_verdicts(rows: list[tuple[Claim, list[Finding]]]) -> dict[str, dict[str, int]]:
    """How often each verdict was given, by flight."""
    flights = [finding.flight for finding in rows[0][1]] if rows else []
    return {
        flight: {
            verdict: sum(findings[i].verdict == verdict for _, findings in rows)
            for verdict in VERDICTS
        }
        for i, flight in enumerate(flights)
    }


def write_ledger(folder: Path) -> list[tuple[Claim, list[Finding]]]:
    """Judge the records below `folder` and write ``claims.json`` there; raises `TrextonError` where there are none."""
    records = load_records(folder)
    if not records:
        raise TrextonError(
            f"{folder}: no records found: run the experiments first (trexton run FLIGHT --out {folder})"
        )
    rows = judge_all(records)
    entries = [
        plain(asdict(claim))
        | {
            "published": claim.published_value,
            "findings": [plain(asdict(finding)) for finding in findings],
        }
        for claim, findings in rows
    ]
    with atomic_file(Path(folder) / "claims.json") as stream:
        stream.write(
            canonical_json({"schema": SCHEMA, "counts": count_verdicts(rows), "claims": entries})
        )
    return rows
