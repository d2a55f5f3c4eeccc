"""The results in a few sentences for the first page; every number from the records."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from trexton.companion.claims.rules import REPRODUCED, Quantity, near
from trexton.companion.experiments.printed import published
from trexton.companion.wording import apart, interval, middle, number, percent

__all__ = ["PLACES", "Headline", "headlines"]

Records = Mapping[str, Mapping[str, Any]]
# How the first page calls the two flights of the book, the real one first.
PLACES = {"cyberzoo": "on the authors' real flight", "sim-survey": "in the virtual hall"}


_DETAIL = re.compile(r"(?=: |, where |, and )")


@dataclass(frozen=True)
class Headline:
    """A sentence, and the experiment that shows it."""

    text: str
    page: str

    @property
    def claim(self) -> str:
        """Its beginning, which says the result."""
        return _DETAIL.split(self.text, maxsplit=1)[0]

    @property
    def detail(self) -> str:
        """The rest: how much, and where."""
        return self.text[len(self.claim) :]


def headlines(records: Records) -> list[Headline]:
    """The sentences that the records at hand allow.

    Parameters
    ----------
    records : mapping
        Values by flight and experiment, as `trexton.companion.build.prose.records_by_name` gives
        them.
    """
    makers = (_accuracy, _filter, _better, _spread, _landing)
    return [headline for make in makers if (headline := make(records)) is not None]


def _on_each(
    records: Records, experiment: str, say: Callable[[Mapping[str, Any]], str]
) -> tuple[str, list[Mapping[str, Any]]]:
    """``A on the real flight and B in the virtual hall``, and the values behind it."""
    flights = [flight for flight in PLACES if experiment in records.get(flight, {})]
    values = [records[flight][experiment] for flight in flights]
    said = [f"{say(each)} {PLACES[flight]}" for flight, each in zip(flights, values, strict=True)]
    return " and ".join(said), values


def _accuracy(records: Records) -> Headline | None:
    text, values = _on_each(
        records, "mocap_training", lambda v: interval(v["filter"]["axis_mean_cm"], "cm")
    )
    if not values:
        return None
    printed = 100 * published()["parameters"]["accuracy_m"]
    errors = [each["filter"]["axis_mean_cm"] for each in values]
    verdicts = [near(Quantity(middle(e), e["low"], e["high"]), printed, "less") for e in errors]
    held = verdicts.count(REPRODUCED)
    where = (
        "is reproduced"
        if held == len(verdicts)
        else "holds in part"
        if held
        else "does not hold here"
    )
    return Headline(
        f"The paper's accuracy of {number(printed)} cm an axis {where}: {text}.", "mocap_training"
    )


def _filter(records: Records) -> Headline | None:
    def say(values: Mapping[str, Any]) -> str:
        error, knn = (interval(values[name]["mean_cm"], "cm") for name in ("filter", "knn"))
        return f"{error} against {knn}, {number(values['lag']['s'])} s late,"

    text, values = _on_each(records, "mocap_training", say)
    if not values:
        return None
    says = _compared([(v["filter"]["mean_cm"], v["knn"]["mean_cm"]) for v in values])
    text = f"Its particle filter {says} the plain mean of its own neighbours: {text}"
    return Headline(f"{text}.", "mocap_training")


def _compared(pairs: Iterable[tuple[Mapping[str, Any], Mapping[str, Any]]]) -> str:
    """``errs less than``: how the first of each pair errs against the second, beyond chance."""
    words = dict.fromkeys(
        "about as much as"
        if not apart(a, b)
        else "more than"
        if middle(a) > middle(b)
        else "less than"
        for a, b in pairs
    )
    return f"errs {'now ' if len(words) > 1 else ''}{', now '.join(words)}"


def _better(records: Records) -> Headline | None:
    """The method beyond the paper."""

    def say(values: Mapping[str, Any]) -> str:
        field, paper = values["field"], values["paper"]
        error = f"{interval(field['mean_cm'], 'cm')} instead of {interval(paper['mean_cm'], 'cm')}"
        return f"{error} (its 90 % region holds {percent(field['held'])})"

    text, values = _on_each(records, "beyond", say)
    if not values:
        return None
    says = _compared([(v["field"]["mean_cm"], v["paper"]["mean_cm"]) for v in values])
    text = f"Beyond the paper, a field of histograms {says} the paper's filter: {text}"
    return Headline(f"{text}.", "beyond")


def _spread(records: Records) -> Headline | None:
    text, values = _on_each(records, "mocap_training", lambda v: percent(v["spread"]["within_two"]))
    if not values:
        return None
    wide = sum(each["spread"]["frames_wider_than_landing"] for each in values)
    frames = sum(each["counts"]["test"] for each in values)
    honest = all(middle(each["spread"]["within_two"]) >= 0.9 for each in values)
    claim = "The particles' spread tells the errors" if honest else "The particles are too sure"
    limit = published()["triggered_landing"]["spread_cm"]
    return Headline(
        f"{claim}: of the errors, twice their spread covers {text}, and the landing threshold of "
        f"{limit} cm holds back {wide:.0f} of {number(frames)} frames.",
        "mocap_training",
    )


def _landing(records: Records) -> Headline | None:
    flight = next((f for f in PLACES if "triggered_landing" in records.get(f, {})), None)
    if flight is None:
        return None
    values = records[flight]["triggered_landing"]
    printed, perfect = published()["triggered_landing"], values["perfect"]
    return Headline(
        f"{values['inside']} of {values['attempts']} flights land inside the zone by the paper's "
        f"trigger {PLACES[flight]}, where the true position gives {perfect['inside']}, and the "
        f"paper had {printed['inside']} of {printed['landings']} landings.",
        "triggered_landing",
    )
