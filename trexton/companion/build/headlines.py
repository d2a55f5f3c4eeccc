"""The results in five sentences for the first page; every number from the records."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from trexton.companion.claims.rules import REPRODUCED, Quantity, near
from trexton.companion.experiments.printed import published
from trexton.companion.wording import apart, middle, number, percent

__all__ = ["PLACES", "Headline", "headlines"]

Records = Mapping[str, Mapping[str, Any]]
Values = Mapping[str, Mapping[str, Any]]  # of one experiment by flight, the real one first
# How the first page calls the two flights of the book, the real one first.
PLACES = {"cyberzoo": "on the authors' real flight", "sim-survey": "in the virtual hall"}


@dataclass(frozen=True)
class Headline:
    """A sentence, and the experiment that shows it."""

    text: str
    page: str


def headlines(records: Records) -> list[Headline]:
    """The sentences that the records at hand allow.

    Parameters
    ----------
    records : mapping
        Values by flight and experiment, as `trexton.companion.build.prose.records_by_name` gives
        them.
    """
    found = []
    for say, experiment in _SENTENCES:
        own = {
            flight: records[flight][experiment]
            for flight in PLACES
            if experiment in records.get(flight, {})
        }
        if own:
            found.append(Headline(say(own), experiment))
    return found


def _accuracy(values: Values) -> str:
    printed = 100 * published()["parameters"]["accuracy_m"]
    errors = {flight: each["filter"]["axis_mean_cm"] for flight, each in values.items()}
    held = [
        flight
        for flight, e in errors.items()
        if near(Quantity(middle(e), e["low"], e["high"]), printed, "less") == REPRODUCED
    ]
    says = "is reproduced" if held == list(errors) else "holds in part" if held else "does not hold"
    unit = " (if its unit is the centimetre)"
    where = " and ".join(
        PLACES[flight] + (unit if flight == "cyberzoo" else "") for flight in held or errors
    )
    return f"The paper's accuracy of {number(printed)} cm an axis {says} {where}."


def _filter(values: Values) -> str:
    says = _compared((v["filter"]["mean_cm"], v["knn"]["mean_cm"]) for v in values.values())
    return f"Its particle filter has {says} error than the plain mean of its own neighbours."


def _compared(pairs: Iterable[tuple[Mapping[str, Any], Mapping[str, Any]]]) -> str:
    """``a larger``: how the first error of each pair compares with the second, beyond chance."""
    words = dict.fromkeys(
        "no clearly larger"
        if not apart(a, b)
        else "a larger"
        if middle(a) > middle(b)
        else "a smaller"
        for a, b in pairs
    )
    return ", elsewhere ".join(words)


def _better(values: Values) -> str:
    """The method beyond the paper."""
    says = _compared((v["field"]["mean_cm"], v["paper"]["mean_cm"]) for v in values.values())
    held = " and ".join(
        f"{percent(middle(each['field']['held']))} {PLACES[flight]}"
        for flight, each in values.items()
    )
    return (
        f"The field of histograms has {says} error than the paper's filter, and its 90 % region "
        f"covers {held}."
    )


def _spread(values: Values) -> str:
    within = {flight: middle(each["spread"]["within_two"]) for flight, each in values.items()}
    claim = "say how large the errors are" if min(within.values()) >= 0.9 else "are overconfident"
    covered = " and ".join(f"{percent(share)} {PLACES[flight]}" for flight, share in within.items())
    return (
        f"The paper's particles {claim}. Twice their spread covers {covered}, where 95 % are due."
    )


def _landing(values: Values) -> str:
    flight, landed = next(iter(values.items()))
    return (
        f"The paper's trigger lands {landed['inside']} of {landed['attempts']} flights inside the "
        f"zone {PLACES[flight]}, and the true position {landed['perfect']['inside']}."
    )


_SENTENCES = (
    (_accuracy, "mocap_training"),
    (_filter, "mocap_training"),
    (_better, "beyond"),
    (_spread, "mocap_training"),
    (_landing, "triggered_landing"),
)
