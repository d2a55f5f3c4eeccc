"""A figure as files: SVG that carries its own data for pages to tell, and a PNG to take home.

`chart_data` reads lines, bars, marks and maps back from drawn axes.
"""

from __future__ import annotations

import io
import json
import re
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection
from matplotlib.container import BarContainer, ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.image import AxesImage
from matplotlib.patches import Rectangle
from matplotlib.transforms import Bbox

# Scales are small numbers of many digits that count, and no coordinates.
_NUMBER = re.compile(r"scale\([^)]*\)|(?<=[ MLQCz\"(,])(-?\d+\.\d{3,})")
_MOST_POINTS = 1200  # more would weigh more than the drawing
_POINTS_PER_INCH = 72


def to_svg(figure: Figure) -> bytes:
    """The figure as SVG, its coordinates to a hundredth of a point, with `chart_data` inside."""
    stream = io.BytesIO()
    # Identifiers are made from a salt when the figure is written; without it every run has others.
    with matplotlib.rc_context({"svg.hashsalt": "trexton"}):
        figure.savefig(stream, format="svg", metadata={"Date": None})
    text = stream.getvalue().decode()
    text = _NUMBER.sub(_rounded, text)
    data = json.dumps(chart_data(figure), separators=(",", ":"), ensure_ascii=True)
    script = f'<script type="application/json" class="chart-data">{_harmless(data)}</script>'
    head, _, tail = text.rpartition("</svg>")
    return f"{head}{script}\n</svg>{tail}".encode()


def _rounded(found: re.Match[str]) -> str:
    return f"{float(found[1]):.2f}".rstrip("0").rstrip(".") if found[1] else found[0]


def to_png(figure: Figure) -> bytes:
    """The figure as a picture of 150 dots an inch."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=150)
    return stream.getvalue()


def _harmless(data: str) -> str:
    """No character that XML or HTML would take for markup."""
    return data.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def chart_data(figure: Figure) -> list[dict[str, Any]]:
    """What the axes of a drawn figure show, in numbers.

    Returns
    -------
    list of dict
        For each of its axes that has something to tell: ``box`` (left, top, right, bottom in
        points from the top left corner), ``x`` and ``y`` (label, limits, scale, names of its
        ticks where they are words) and ``lines`` (label, x, y).
    """
    height = figure.get_size_inches()[1] * _POINTS_PER_INCH
    shrink = _POINTS_PER_INCH / figure.dpi
    found = []
    for axes in figure.axes:
        lines = _lines(axes)
        if not lines:
            continue
        frame: Bbox = axes.get_window_extent()
        box = (frame.x0, height / shrink - frame.y1, frame.x1, height / shrink - frame.y0)
        found.append(
            {
                "box": [round(float(shrink * value), 2) for value in box],
                "x": _axis(axes, "x"),
                "y": _axis(axes, "y"),
                "lines": lines,
            }
        )
    return found


def _axis(axes: Axes, which: str) -> dict[str, Any]:
    low, high = axes.get_xlim() if which == "x" else axes.get_ylim()
    axis = axes.xaxis if which == "x" else axes.yaxis
    label = axis.get_label_text()
    for other in axes.get_shared_x_axes().get_siblings(axes) if which == "x" and not label else ():
        label = label or other.xaxis.get_label_text()
    names = {
        f"{place:.6g}": tick.get_text()
        for place, tick in zip(axis.get_ticklocs(), axis.get_ticklabels(), strict=False)
        if re.search(r"^[^$]*[A-Za-z]", tick.get_text())
    }
    if names and len(names) == len(axis.get_ticklocs()):  # groups: beside a tick is of its kind
        ticks = np.asarray(axis.get_ticklocs())
        for value in _grouped(axes, which):
            nearest = ticks[np.argmin(np.abs(ticks - value))]
            names.setdefault(f"{value:.4g}", names[f"{nearest:.6g}"])
    return {
        "label": label.replace("$", ""),
        "limits": [float(f"{value:.8g}") for value in (low, high)],
        "log": axis.get_scale() == "log",
        **({"names": names} if names else {}),
    }


def _grouped(axes: Axes, which: str) -> list[float]:
    """Where bars, and marks with an interval, stand along an axis."""
    found: list[float] = []
    for held in axes.containers:
        if isinstance(held, BarContainer) and (held.orientation == "vertical") == (which == "x"):
            found += [_middle(bar, which) for bar in held.patches]
        elif isinstance(held, ErrorbarContainer) and held.lines[0] is not None:
            found += list(np.asarray(held.lines[0].get_xydata())[:, "xy".index(which)])
    return found


def _middle(bar: Rectangle, which: str) -> float:
    low, size = (bar.get_x(), bar.get_width()) if which == "x" else (bar.get_y(), bar.get_height())
    return float(low + size / 2)


def _lines(axes: Axes) -> list[dict[str, Any]]:
    """Everything in the axes that has a label, as points."""
    found: list[tuple[object, Any, Any]] = []
    barred = {
        held.lines[0]: held for held in axes.containers if isinstance(held, ErrorbarContainer)
    }
    for line in axes.get_lines():
        x, y = np.asarray(line.get_xydata()).T
        if len(x) > 2 or line.get_marker() not in ("None", None, "", " "):
            found.append((barred.get(line, line).get_label(), x, y))
    for held in axes.containers:
        if isinstance(held, BarContainer):
            middles = [
                (_middle(bar, "x"), bar.get_y() + bar.get_height())
                if held.orientation == "vertical"
                else (bar.get_x() + bar.get_width(), _middle(bar, "y"))
                for bar in held.patches
            ]
            if middles:
                found.append((held.get_label(), *np.array(middles).T))
    for drawn in axes.collections:  # of what fills an area, nothing: its corners tell nothing
        if isinstance(drawn, PathCollection):
            found.append((drawn.get_label(), *np.asarray(drawn.get_offsets()).reshape(-1, 2).T))
    for image in axes.images:
        if _said(image.get_label()) and image.origin == "lower":
            found += _valued(image.get_label(), *_cells(image))
    return [
        {"label": _said(label), "x": _short(x), "y": _short(y)}
        for label, x, y in found
        if 0 < len(x) <= _MOST_POINTS and _numeric(x) and _numeric(y)
    ]


def _cells(image: AxesImage) -> tuple[np.ndarray, np.ndarray]:
    """Centres of the cells of a map that have a value, and the values."""
    values: np.ndarray = np.ma.filled(np.ma.asarray(image.get_array(), dtype=float), np.nan)
    left, right, bottom, top = image.get_extent()
    rows, columns = np.nonzero(np.isfinite(values))
    x = left + (columns + 0.5) * (right - left) / values.shape[1]
    y = bottom + (rows + 0.5) * (top - bottom) / values.shape[0]
    return np.stack([x, y], axis=1), values[rows, columns]


def _valued(label: object, places: Any, values: Any) -> list[tuple[object, Any, Any]]:
    """Places that bear a value each, those of one rounded value together."""
    said = np.array([f"{_said(label)}: {value:.2g}" for value in values])
    return [(value, *np.asarray(places)[said == value].T) for value in np.unique(said)]


def _said(label: object) -> str:
    return "" if str(label).startswith("_") else str(label)


def _numeric(values: Any) -> bool:
    return np.asarray(values).dtype.kind in "fiu"


def _short(values: Any) -> list[float | None]:
    """Four digits, enough to be told."""
    return [float(f"{v:.4g}") if np.isfinite(v) else None for v in np.asarray(values, dtype=float)]
