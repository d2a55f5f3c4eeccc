"""Numbers as words. What findings, the ledger and the prose say is written here, from records."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial
from html import escape
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment

METRES_FROM = 200  # centimetres: longer distances are said in metres
UNKNOWN = "–"  # what a record holds no number for, as a correlation with what is constant
_TITLES = {
    "cyberzoo": "CyberZoo flight (real, unit in doubt)",
    "sim-survey": "Virtual hall (simulated)",
    "sim-waypoints": "Virtual hall, an hour later (simulated)",
}


def flight_title(name: str) -> str:
    """A name that a reader can say; flights of a person's own keep the name in their header."""
    return _TITLES.get(name, name)


def number(value: float | None) -> str:
    """Two or three digits that count, thousands apart; whole numbers, which count, as they are."""
    if value is None:
        return UNKNOWN
    if abs(value) >= 100:
        return f"{value if isinstance(value, int) else float(f'{value:.3g}'):,.0f}"
    return f"{value:.3g}" if abs(value) >= 1 else f"{value:.2g}"


def middle(entry: Mapping[str, Any] | float) -> float:
    """The value of an entry, or the number itself."""
    return float(entry["value"] if isinstance(entry, Mapping) else entry)


def interval(entry: Mapping[str, Any], unit: str = "") -> str:
    """``102 [85, 122] cm``: the middle, its 95 % interval, the unit."""
    text = f"{number(middle(entry))} [{number(entry['low'])}, {number(entry['high'])}]"
    return f"{text} {unit}".strip()


def distance(entry: Mapping[str, Any] | float, metres: bool | None = None) -> str:
    """A distance given in cm, with its interval if it has one; in metres from two metres on, or as
    `metres` says.
    """
    metres = middle(entry) >= METRES_FROM if metres is None else metres
    unit, scale = ("m", 0.01) if metres else ("cm", 1.0)
    if not isinstance(entry, Mapping):
        return f"{number(scale * entry)} {unit}"
    return interval({key: scale * entry[key] for key in ("value", "low", "high")}, unit)


def lengths(cm: float) -> Callable[[Mapping[str, Any] | float], str]:
    """Says distances in cm in one unit: that of this one."""
    return partial(distance, metres=cm >= METRES_FROM)


def percent(share: Mapping[str, Any] | float | None) -> str:
    """A share in per cent, with a decimal below ten, two of very little, and its interval if that
    has a width.
    """
    if share is None:
        return UNKNOWN
    if isinstance(share, Mapping):
        low, high = (percent(share[key]).removesuffix(" %") for key in ("low", "high"))
        if low == high:  # of draws that are all alike nothing is drawn but them
            return percent(middle(share))
        return f"{percent(middle(share))} [{low}, {high}]"
    value = 100 * share
    if 0.005 <= abs(value) < 0.05:
        return f"{value:.2f} %"
    decimal = abs(value) < 9.95 and abs(value - round(value)) >= 0.05
    return f"{value:.{int(decimal)}f} %"


def times(ratio: float) -> str:
    """``2.1 times``; ``twice`` where that is what it is."""
    if abs(ratio - 2) < 0.05:
        return "twice"
    return f"{ratio:.0f} times" if ratio >= 9.95 else f"{ratio:.1f} times"


def beside(ratio: float) -> str:
    """``62 % of``, ``about as much as``, ``2.1 times as much as``: before what is compared with."""
    if abs(ratio - 1) < 0.05:
        return "about as much as"
    return f"{percent(ratio)} of" if ratio < 1 else f"{times(ratio)} as much as"


def apart(a: Mapping[str, Any], b: Mapping[str, Any]) -> bool:
    """Whether two intervals do not overlap."""
    return bool(a["high"] < b["low"] or b["high"] < a["low"])


def fixed(value: float | None, digits: int = 0) -> str:
    """A number with so many decimals and thousands apart."""
    return UNKNOWN if value is None else f"{value:,.{digits}f}"


def span(entry: Mapping[str, Any], digits: int = 0) -> str:
    """The value of an entry with its interval in brackets."""
    value, low, high = (fixed(entry[key], digits) for key in ("value", "low", "high"))
    return f"{value} [{low}, {high}]"


def text(words: str) -> str:
    """Words from a flight's header, with everything that Markdown would take for markup made
    harmless.
    """
    return re.sub(r"([^\w\s.,;:'()/-])", r"\\\1", " ".join(str(words).split()))


def as_html(words: str) -> str:
    """Escaped, with `code` in backquotes set as such."""
    return re.sub(r"`([^`]+)`", r"<code>\1</code>", escape(words))


def template_environment() -> Environment:
    """Templates for prose: a name that is not there is an error; ``{{ x | fixed }}`` and kin.

    ``{#`` would swallow attributes of MyST, so comments get marks of their own.
    """
    import jinja2

    environment = jinja2.Environment(
        undefined=jinja2.StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
        comment_start_string="{##",
        comment_end_string="##}",
        autoescape=False,
    )
    # A name is an entry, also where dict has a method of that name.
    environment.getattr = environment.getitem  # type: ignore[method-assign, assignment]
    filters = (fixed, span, text, number, percent, interval)
    environment.filters |= {each.__name__: each for each in filters}
    return environment
