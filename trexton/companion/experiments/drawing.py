"""A figure as files: SVG for pages, and a PNG to take home."""

from __future__ import annotations

import io
import re

import matplotlib
from matplotlib.figure import Figure

# Scales are small numbers of many digits that count, and no coordinates.
_NUMBER = re.compile(r"scale\([^)]*\)|(?<=[ MLQCz\"(,])(-?\d+\.\d{3,})")


def to_svg(figure: Figure) -> bytes:
    """The figure as SVG, its coordinates to a hundredth of a point."""
    stream = io.BytesIO()
    # Identifiers are made from a salt when the figure is written; without it every run has others.
    with matplotlib.rc_context({"svg.hashsalt": "trexton"}):
        figure.savefig(stream, format="svg", metadata={"Date": None})
    return _NUMBER.sub(_rounded, stream.getvalue().decode()).encode()


def _rounded(found: re.Match[str]) -> str:
    return f"{float(found[1]):.2f}".rstrip("0").rstrip(".") if found[1] else found[0]


def to_png(figure: Figure) -> bytes:
    """The figure as a picture of 150 dots an inch."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=150)
    return stream.getvalue()
