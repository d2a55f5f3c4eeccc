"""The rules of the ledger, one for each kind of claim, the same for every claim and every flight.

An interval is a 95 % interval; a quantity without one counts as exact.

``value``
    *Reproduced*: the printed value lies in our interval, ours is within a quarter of it, and the
    interval does not reach beyond half or twice of it. *Reproduced in direction*: within a quarter,
    but our interval excludes it. *Better than the paper*: our whole interval is on its better side
    and ours is more than a quarter away. *Inconclusive*: our interval holds it, and values that
    would contradict it as well. Else *not reproduced*.
``below``, ``above``
    *Reproduced* if our whole interval obeys the bound, *not reproduced* if all of it breaks it,
    else *inconclusive*.
``order``
    `less` is smaller than `greater`. *Reproduced* if the intervals do not overlap; *reproduced in
    direction* if they do, but neither holds the other's middle; *inconclusive* if one does; *not
    reproduced* where the order is the other way round, or the ratio exceeds `at_most_times`.
``exact``
    Equal or not.
``untestable``
    *Not testable here*, for the stated reason. All times, rates and shares of time that the paper
    took on its own computers are of this kind; two times of one machine can be put in order.

What holds whatever was measured is *true by construction* and counted apart.
"""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["KINDS", "VERDICTS", "Quantity", "equal", "in_order", "near", "within_bound"]

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
KINDS = ("value", "below", "above", "order", "exact", "untestable")
QUARTER, FACTOR = 0.25, 2.0


@dataclass(frozen=True)
class Quantity:
    """A value and its 95 % interval (equal to the value where there is none)."""

    value: float
    low: float
    high: float

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high


def near(ours: Quantity, printed: float, better: str = "") -> str:
    """The rule of a printed value; `better` is "less" or "more" where one side of it is better."""
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


def within_bound(ours: Quantity, bound: float, side: str) -> str:
    """The rule of a bound: `side` is "below" (at most) or "above" (at least)."""
    sign = 1 if side == "below" else -1
    ends = sorted((sign * ours.low, sign * ours.high))
    if ends[1] <= sign * bound:
        return REPRODUCED
    return FAILED if ends[0] > sign * bound else INCONCLUSIVE


def in_order(less: Quantity, greater: Quantity, at_most_times: float | None = None) -> str:
    """The rule of a comparison; beyond `at_most_times` the difference is not the one claimed."""
    if less.value in greater or greater.value in less:
        return INCONCLUSIVE
    if less.value > greater.value:
        return FAILED
    if at_most_times is not None and greater.value > at_most_times * less.value:
        return FAILED
    return REPRODUCED if less.high < greater.low else DIRECTION


def equal(ours: Quantity, printed: float) -> str:
    """The rule of a count."""
    return REPRODUCED if ours.value == printed else FAILED
