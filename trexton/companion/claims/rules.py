"""The rules of the ledger, one for each kind of claim, the same for every claim and every flight.

Offers `RULES`, which give a verdict on a quantity with its 95 % interval (one without counts as
exact); the page of the ledger tells them in words. What is *untestable* has no rule: all times,
rates and shares of time that the paper took on its own computers. What holds whatever was measured
is *true by construction* and counted apart.
"""

from collections.abc import Callable
from dataclasses import dataclass

VERDICTS = (
    "reproduced",
    "reproduced in direction",
    "better than the paper",
    "inconclusive",
    "not reproduced",
    "true by construction",
    "not testable here",
)
REPRODUCED, DIRECTION, BETTER, INCONCLUSIVE, FAILED, CONSTRUCTED, UNTESTABLE = VERDICTS
QUARTER, FACTOR = 0.25, 2.0


@dataclass(frozen=True)
class Quantity:
    """A value and its 95 % interval (equal to the value where there is none)."""

    value: float
    low: float
    high: float
    clusters: int | None = None  # of trials that may be alike, of a rate

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high

    def __str__(self) -> str:
        if self.low == self.high:
            return f"{self.value:.3g}"
        return f"{self.value:.3g} [{self.low:.3g}, {self.high:.3g}]"


def near(ours: Quantity, printed: float, better: str = "") -> str:
    """The rule of a printed value; `better` is "less" or "more" where one side of it is better.

    *Reproduced* takes both: the value in our interval and ours within a quarter of it. A wide
    interval, which reaches beyond half or twice the value, reproduces nothing.
    """
    close = abs(ours.value - printed) <= QUARTER * abs(printed)
    if printed in ours:
        far = max(ours.high - printed, printed - ours.low)
        wide = (
            ours.low < printed / FACTOR or ours.high > printed * FACTOR if printed > 0 else far > 0
        )
        return REPRODUCED if close and not wide else INCONCLUSIVE
    if close:
        return DIRECTION
    if (better == "less" and ours.high < printed) or (better == "more" and ours.low > printed):
        return BETTER
    return FAILED


def below(ours: Quantity, bound: float) -> str:
    """The rule of a bound: the whole interval obeys it, or breaks it."""
    if ours.high <= bound:
        return REPRODUCED
    return FAILED if ours.low > bound else INCONCLUSIVE


def above(ours: Quantity, bound: float) -> str:
    """The same of a bound from below."""
    return below(Quantity(-ours.value, -ours.high, -ours.low), -bound)


def in_order(less: Quantity, greater: Quantity, at_most_times: float | None = None) -> str:
    """The rule of a comparison: *reproduced* if the intervals do not overlap, *in direction* if
    neither holds the other's middle; beyond `at_most_times` the difference is not the one claimed.
    """
    if less.value in greater or greater.value in less:
        return INCONCLUSIVE
    if less.value > greater.value:
        return FAILED
    if at_most_times is not None and greater.value > at_most_times * less.value:
        return FAILED
    return REPRODUCED if less.high < greater.low else DIRECTION


# By kind: the rule in a reader's words, and how it judges ours (and what ours is compared with).
RULES: dict[str, tuple[str, Callable[..., str]]] = {
    "value": ("the printed value in our interval, and within a quarter", near),
    "below": ("at most {}, with the whole interval", below),
    "above": ("at least {}, with the whole interval", above),
    "order": ("the first is smaller, intervals apart", in_order),
    "exact": ("equal", lambda ours, printed: REPRODUCED if ours.value == printed else FAILED),
}
