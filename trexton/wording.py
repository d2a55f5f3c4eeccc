"""Numbers as words: what findings, the ledger and the prose say is written here, from records."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

__all__ = ["apart", "interval", "middle", "number", "percent", "times"]


def number(value: float) -> str:
    """Two or three digits that count, thousands apart."""
    if abs(value) >= 100:
        return f"{value:,.0f}"
    return f"{value:.3g}" if abs(value) >= 1 else f"{value:.2g}"


def middle(entry: Mapping[str, Any] | float) -> float:
    """The median (or value) of an entry, or the number itself."""
    if isinstance(entry, Mapping):
        return float(entry["median"] if "median" in entry else entry["value"])
    return float(entry)


def interval(entry: Mapping[str, Any], unit: str = "") -> str:
    """``102 [85, 122] cm``: the middle, its 95 % interval, the unit."""
    text = f"{number(middle(entry))} [{number(entry['low'])}, {number(entry['high'])}]"
    return f"{text} {unit}".strip()


def percent(share: float) -> str:
    """A share in per cent, with a decimal only below ten."""
    value = 100 * share
    digits = 1 if 0 < abs(value) < 9.95 and abs(value - round(value)) >= 0.05 else 0
    return f"{value:.{digits}f} %"


def times(ratio: float) -> str:
    """``2.1 times``; ``twice`` where that is what it is."""
    if abs(ratio - 2) < 0.05:
        return "twice"
    return f"{ratio:.0f} times" if ratio >= 9.95 else f"{ratio:.1f} times"


def apart(a: Mapping[str, Any], b: Mapping[str, Any]) -> bool:
    """Whether two intervals do not overlap."""
    return bool(a["high"] < b["low"] or b["high"] < a["low"])
