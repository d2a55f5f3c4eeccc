"""The few icons of the theme as inline SVG of our own, in place of a font of thousands."""

from __future__ import annotations

import re

__all__ = ["with_icons"]

# Strokes on a grid of 24 by 24.
_STROKES = {
    "angle-left": "M15 5l-7 7 7 7",
    "angle-right": "M9 5l7 7-7 7",
    "arrow-up": "M12 20V5M5 12l7-7 7 7",
    "bars": "M4 6h16M4 12h16M4 18h16",
    "chevron-down": "M5 9l7 7 7-7",
    "list": "M4 6h1M9 6h11M4 12h1M9 12h11M4 18h1M9 18h11",
    "magnifying-glass": "M16 10a6 6 0 1 1-12 0 6 6 0 0 1 12 0zM14.5 14.5L20 20",
    "sun": "M16 12a4 4 0 1 1-8 0 4 4 0 0 1 8 0zM12 2v3M12 19v3M2 12h3M19 12h3"
    "M5 5l2 2M17 17l2 2M19 5l-2 2M7 17l-2 2",
    "moon": "M19 14.5A8 8 0 1 1 9.5 5 6.5 6.5 0 0 0 19 14.5z",
    "circle-half-stroke": "M20 12a8 8 0 1 1-16 0 8 8 0 0 1 16 0zM12 4v16M15 6v12M18 8.5v7",
}
_ICON = re.compile(
    r'<(?P<tag>i|span) class="(?P<class>[^"]*\bfa-(?:solid|regular|brands)\b[^"]*)"'
    r"(?P<rest>[^>]*)></(?P=tag)>"
)


def with_icons(html: str) -> str:
    """`html` with every icon of the font drawn in place; one that is not drawn here stays away."""
    return _ICON.sub(_drawn, html)


def _drawn(match: re.Match[str]) -> str:
    names = [word[3:] for word in match["class"].split() if word.startswith("fa-")]
    path = next((_STROKES[name] for name in names if name in _STROKES), "")
    drawing = (
        '<svg class="icon" viewBox="0 0 24 24" width="1em" height="1em" aria-hidden="true" '
        'focusable="false" fill="none" stroke="currentColor" stroke-width="2" '
        f'stroke-linecap="round" stroke-linejoin="round"><path d="{path}"/></svg>'
    )
    return f'<i class="{match["class"]}"{match["rest"]}>{drawing}</i>'
