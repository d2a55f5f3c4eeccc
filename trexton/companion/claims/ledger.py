"""Claims are read from ``data/paper/claims.toml``. The records of each flight judge them."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from trexton.base.errors import ParameterError, TrextonError
from trexton.base.files import canonical_json, read_toml, write_file
from trexton.base.options import Options, option
from trexton.base.records import Record, plain
from trexton.companion.claims import rules
from trexton.companion.claims.rules import Quantity
from trexton.companion.experiments.printed import look_up, paper_file, published
from trexton.companion.experiments.rates import wilson_interval
from trexton.companion.experiments.registry import EXPERIMENTS

SCHEMA = 2
Records = dict[str, Record]
Rows = list[tuple["Claim", list["Finding"]]]


@dataclass(frozen=True)
class Claim(Options):
    """One claim of the paper and our test of it: a table of ``claims.toml``."""

    id: str = option("", "its name")
    place: str = option("", "where the paper says it")
    text: str = option("", "what it says, in our words")
    kind: str = option("", "the rule", choices=(*rules.RULES, "untestable"))
    experiment: str = option("none", "the page that tests it")
    printed: str | int | float | None = option(
        None, "the value that the paper prints, or its place in published.toml"
    )
    measure: str = option("", "what our test measures")
    bound: int | float | None = option(None, "our own threshold, of a bound")
    at_most_times: int | float | None = option(None, "our own threshold, of the ratio of an order")
    better: str = option("", "the side of the printed value that is", choices=("", "less", "more"))
    unit: str = option("", "of the printed value and ours")
    ours: str | None = option(None, "EXPERIMENT:PATH into a record's values or timings")
    less: str | None = option(None, "the same, of an order: what is smaller")
    greater: str | None = option(None, "and what is greater")
    needs: str = option("", "what a flight must have for the test; where it lacks that, the reason")
    by_construction: str = option("", "why it holds whatever was measured, where it does")
    data: str = option("", "the title of the data that its experiment has in the flight's place")
    reason: str = option("", "why it cannot be tested here, where it cannot")
    label: str = option("", "what its number is, where its name does not say it")

    def __post_init__(self) -> None:
        try:
            super().__post_init__()
        except ParameterError as error:
            raise ParameterError(f"claim {self.id!r}: {error}") from None
        for reference in self.references:
            experiment, _, path = reference.partition(":")
            if experiment not in EXPERIMENTS or not path:
                raise ParameterError(
                    f"claim {self.id!r} refers to {reference!r}: expected EXPERIMENT:PATH with one "
                    f"of the experiments {', '.join(EXPERIMENTS)}"
                )
        expected = {"order": 2, "untestable": len(self.references)}.get(self.kind, 1)
        if len(self.references) != expected or (self.kind == "untestable" and not self.reason):
            raise ParameterError(
                f"claim {self.id!r} of kind {self.kind!r} has {len(self.references)} references: "
                "expected less and greater for an order, ours else, a reason where untestable"
            )

    @property
    def references(self) -> list[str]:
        """What it reads of the records."""
        return [each for each in (self.ours, self.less, self.greater) if each]

    @property
    def printed_value(self) -> float | None:
        """The number that the paper prints, looked up where `printed` is a place; or None."""
        if not isinstance(self.printed, str):
            return self.printed
        value = look_up(published(), self.printed)
        if not isinstance(value, (int, float)):
            raise ParameterError(
                f"claim {self.id!r} names {self.printed!r}: "
                "expected a number of data/paper/published.toml"
            )
        return float(value)

    @property
    def threshold(self) -> float:
        """What ours is held against: our bound, or the value that the paper prints."""
        value = self.printed_value if self.bound is None else self.bound
        if value is None:
            raise ParameterError(f"claim {self.id!r} has neither a bound nor a printed value")
        return value

    @property
    def rule(self) -> str:
        """The rule as a reader may read it."""
        if self.kind == "untestable":
            return ""
        bound = f"{self.threshold:g} {self.unit}".rstrip() if self.kind in _HELD_AGAINST else ""
        return rules.RULES[self.kind][0].format(bound)


_HELD_AGAINST = ("value", "below", "above", "exact")  # the kinds with a threshold


@dataclass(frozen=True)
class Finding:
    """What one flight says about a claim."""

    flight: str
    verdict: str
    ours: Quantity | None = None
    other: Quantity | None = None
    reason: str = ""


def load_claims(path: Path | None = None, experiments: Iterable[str] = EXPERIMENTS) -> list[Claim]:
    """All claims, in the order of the paper, then those that `experiments` declare themselves.

    Raises `ParameterError` where one refers to an experiment or a printed value that is not there.
    """
    tables = read_toml(path or paper_file("claims.toml"))["claim"]
    if path is None:
        for name in experiments:
            tables += [{"experiment": name} | table for table in EXPERIMENTS[name].claims]
    claims = [Claim(**table) for table in tables]
    for claim in claims:
        if claim.kind in _HELD_AGAINST:
            claim.threshold  # noqa: B018 - looked up now rather than when a page is made
    return claims


def load_records(folder: Path) -> dict[str, Records]:
    """Records below `folder`, by flight and experiment."""
    records: dict[str, Records] = {}
    for path in sorted(Path(folder).glob("*/*.json")):
        if not path.name.startswith((".", "claims")):
            record = Record.load(path)
            records.setdefault(record.flight, {})[record.experiment] = record
    return records


def _quantity(claim: Claim, reference: str, records: Records) -> Quantity | None:
    """The quantity that a claim names; None where the flight lacks it.

    Raises `ParameterError` where the record lacks the path though the claim `needs` nothing.
    """
    experiment, _, path = reference.partition(":")
    if experiment not in records:
        return None
    record = records[experiment]
    above, _, last = path.rpartition(".")
    parents = [look_up(tree, above) if above else tree for tree in (record.values, record.timings)]
    entries = [parent[last] for parent in parents if isinstance(parent, dict) and last in parent]
    if not entries and not (claim.needs or claim.reason):
        raise ParameterError(
            f"claim {claim.id!r} reads {reference!r}, which the record of flight "
            f"{record.flight!r} does not have: correct its path in data/paper/claims.toml"
        )
    entry = next((entry for entry in entries if entry is not None), None)
    if not isinstance(entry, dict):
        return Quantity(entry, entry, entry) if isinstance(entry, (int, float)) else None
    value = entry.get("value", entry.get("median"))  # the latter of times
    if value is None:
        return None
    low, high = (value if entry.get(end) is None else entry[end] for end in ("low", "high"))
    return Quantity(float(value), float(low), float(high), entry.get("clusters"))


def judge(claim: Claim, records: Records, flight: str = "") -> Finding:
    """The verdict of one flight's records on one claim.

    Of a flight whose parts were exchanged it says so where the verdict turns, and where what the
    claim reads was judged one way only.
    """
    finding = _judge(claim, records, flight)
    exchanged = {
        name: known
        for name, record in records.items()
        if isinstance(known := record.values.get("exchanged"), dict)
    }
    if not exchanged or finding.verdict in (rules.UNTESTABLE, rules.CONSTRUCTED):
        return finding
    said = "judged one way only"
    read = [reference.partition(":") for reference in claim.references]
    if all(path.partition(".")[0] in exchanged.get(name, {}) for name, _, path in read):
        other = {
            name: replace(records[name], values=records[name].values | known)
            for name, known in exchanged.items()
        }
        turned = _judge(claim, records | other, flight)
        if turned.verdict == finding.verdict:
            return finding
        said = f"with training and test exchanged: {turned.verdict} ({turned.ours})"
    return replace(finding, reason="; ".join(filter(None, [finding.reason, said])))


def _judge(claim: Claim, records: Records, flight: str) -> Finding:
    quantities = [_quantity(claim, reference, records) for reference in claim.references]
    first, second = (quantities + [None, None])[:2]
    if claim.kind == "untestable":
        return Finding(flight, rules.UNTESTABLE, first, second, claim.reason)
    if first is None or (claim.kind == "order" and second is None):
        return Finding(flight, rules.UNTESTABLE, first, second, _absence(claim, records))
    if claim.kind == "above" and first.clusters is not None:
        best, _ = wilson_interval(first.clusters, first.clusters)
        if best < claim.threshold:  # whatever happens
            reason = f"{first.clusters} independent groups of trials are too few for a verdict"
            return Finding(flight, rules.UNTESTABLE, first, second, reason)
    if claim.kind == "order":
        against: tuple[object, ...] = second, claim.at_most_times
    else:
        against = claim.threshold, *([claim.better] if claim.kind == "value" else [])
    verdict, reason = rules.RULES[claim.kind][1](first, *against), ""
    if claim.by_construction and verdict == rules.REPRODUCED:
        verdict, reason = rules.CONSTRUCTED, claim.by_construction
    elif verdict == rules.BETTER and first.value * claim.threshold > 0:
        ratio = max(first.value / claim.threshold, claim.threshold / first.value)
        share = f"better by {100 * (1 - 1 / ratio):.0f} %"
        reason = f"{ratio:.0f} times better" if ratio >= 2 else share
    elif verdict == rules.FAILED and claim.at_most_times and second is not None:
        if second.value > first.value:
            reason = f"{second.value / first.value:.0f} times as much, where at most "
            reason += f"{claim.at_most_times:g} times was claimed"
    return Finding(flight, verdict, first, second, reason)


def _absence(claim: Claim, records: Records) -> str:
    """Why a flight cannot answer, in a reader's words."""
    names = [reference.partition(":")[0] for reference in claim.references]
    missing = [EXPERIMENTS[name].title for name in names if name not in records]
    text = f"“{missing[0]}” was not run" if missing else "nothing of the kind happened"
    return f"{text} on this flight" + (f"; the test needs {claim.needs}" if claim.needs else "")


def judge_all(records: dict[str, Records], claims: list[Claim] | None = None) -> Rows:
    """Every claim, in the order of the paper, with its finding on each flight."""
    claims = load_claims() if claims is None else claims
    return [
        (claim, [judge(claim, records[flight], flight) for flight in sorted(records)])
        for claim in claims
    ]


def count_verdicts(rows: Rows) -> dict[str, dict[str, int]]:
    """How often each verdict was given, by flight."""
    counts: dict[str, dict[str, int]] = {}
    for _, findings in rows:
        for finding in findings:
            own = counts.setdefault(finding.flight, dict.fromkeys(rules.VERDICTS, 0))
            own[finding.verdict] += 1
    return counts


def write_ledger(folder: Path) -> Rows:
    """Judge the records below `folder` and write ``claims.json`` there.

    Raises `TrextonError` where there are none.
    """
    records = load_records(folder)
    if not records:
        raise TrextonError(
            f"{folder}: no records found: run the experiments first "
            f"(trexton run FLIGHT --out {folder})"
        )
    rows = judge_all(records)
    entries = [
        asdict(claim)
        | {
            "printed": claim.printed_value,
            "rule": claim.rule,
            "findings": [asdict(finding) for finding in findings],
        }
        for claim, findings in rows
    ]
    content = {"schema": SCHEMA, "counts": count_verdicts(rows), "claims": plain(entries)}
    write_file(Path(folder) / "claims.json", canonical_json(content))
    return rows
