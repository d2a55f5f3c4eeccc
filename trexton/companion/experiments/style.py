"""The style that all figures share: colours for all eyes, readable on light and dark pages.

Offers the canvas, floor plans, marks with intervals, heat maps and legends.
"""

import itertools
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, cast

import matplotlib.pyplot as plt
import numpy as np
from cycler import cycler
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from trexton.base.records import Record
from trexton.companion.wording import METRES_FROM

# What a colour means, in every figure and in the player: Okabe & Ito (2008), without yellow, which
# fades on white. Kinds of one method differ by their strokes. A page lightens them in the dark.
COLORS = {
    "truth": "#4d4d4d",  # and lines that stand still: a limit, a rate, a tolerance
    "paper": "#D55E00",  # the paper's filter
    "other": "#CC79A7",  # the paper's filter, changed
    "field": "#0072B2",
    "fine": "#009E73",
    "neighbors": "#56B4E9",
    "particles": "#E69F00",
    "homography": "#8C5A2B",  # keypoints and a homography, whatever the map
    "printed": "#8A63D2",  # a value that the paper prints; it needs no other shade in the dark
    "zone": "#777777",
}
# Where no methods are compared: one after another.
SERIES = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#4d4d4d")

_STYLE: dict[str, Any] = {
    "svg.hashsalt": "trexton",
    "svg.fonttype": "path",
    "font.size": 10,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.titleweight": "bold",
    "axes.labelcolor": "#333333",
    "axes.edgecolor": "#999999",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.prop_cycle": cycler(color=SERIES),
    "grid.color": "#e3e3e3",
    "grid.linewidth": 0.6,
    "xtick.color": "#555555",
    "ytick.color": "#555555",
    "lines.linewidth": 1.4,
    "legend.frameon": False,
    "legend.fontsize": 9,
    # A page in dark mode shows its figures on their own white card.
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "figure.constrained_layout.use": True,
    "image.interpolation": "nearest",
}


@contextmanager
def canvas(
    rows: int = 1, columns: int = 1, *, size: tuple[float, float] = (7.2, 3.2), **options: Any
) -> Iterator[tuple[Figure, np.ndarray]]:
    """A figure and its axes (always a 2-D array) in the common style; it is not kept by pyplot."""
    with plt.rc_context(cast(Any, _STYLE)):
        figure = Figure(figsize=size)
        yield figure, figure.subplots(rows, columns, squeeze=False, **options)
        # Text and ticks take their style when they are drawn.
        figure.draw_without_rendering()


def floor_axes(axes: Axes, area: Sequence[float]) -> None:
    """Axes of a floor plan in metres, both to the same scale."""
    axes.set(xlim=area[:2], ylim=area[2:], xlabel="x (m)", ylabel="y (m)", aspect="equal")
    axes.grid(False)


def show_floor(
    axes: Axes, floor: dict[str, Any] | None, picture: np.ndarray | None, fade: float = 0.45
) -> None:
    """Put the floor's picture (BGR) under a plan; `floor` holds its extent, as records carry it."""
    if floor is None or picture is None:
        axes.grid(True)
        return
    # Transparent rather than mixed with white, so that it fades into a dark page too.
    alpha = np.full(picture.shape[:2], round(255 * fade), np.uint8)
    faded = np.dstack([picture[..., 2::-1], alpha])
    axes.imshow(faded, extent=floor["extent_m"], interpolation="bilinear", zorder=0)


@contextmanager
def plan_canvas(
    record: Record, size: tuple[float, float], floor: str = "floor", fade: float = 0.45
) -> Iterator[tuple[Figure, Axes]]:
    """A plan of the area of a record, over the picture that it holds of its `floor`, if any."""
    with canvas(size=size) as (figure, axes):
        floor_axes(axes[0, 0], record.series["area_m"])
        show_floor(axes[0, 0], record.series.get(floor), record.images.get(floor), fade)
        yield figure, axes[0, 0]


def joined_plan(
    record: Record, key: str, label: str, color: str, *, floor: str = "floor", every: int = 1
) -> Figure:
    """The true track over the floor and every so many of the estimates, joined to where they should
    be; crosses where there is none.
    """
    truth = np.array(record.series["truth_m"])
    rows, place = truth[::every], np.array(record.series[key], dtype=float)[::every]
    lost = ~np.isfinite(place).all(axis=1)
    with plan_canvas(record, (5.6, 5.4), floor) as (figure, plan):
        for pair in zip(rows[~lost], place[~lost], strict=True):
            plan.plot(*np.transpose(pair), color=color, linewidth=0.6, alpha=0.6)
        plan.plot(*truth.T, color=COLORS["truth"], linewidth=1.8, label="true track")
        plan.plot(*place[~lost].T, "o", color=color, markersize=3, label=label)
        if lost.any():
            plan.plot(*rows[lost].T, "x", color=color, label=f"nothing ({lost.sum()})")
        legend_below(plan, 0.12, columns=3)
    return figure


def band(axes: Axes, x: Any, low: Any, middle: Any, high: Any, *, color: str, **line: Any) -> None:
    """A line, and the interval around it as an area."""
    axes.fill_between(x, low, high, color=color, alpha=0.15, linewidth=0)
    axes.plot(x, middle, color=color, **line)


def name_points(axes: Axes, points: Mapping[str, tuple[float, float]]) -> None:
    """A name beside each point of two logarithmic axes, where it hides no other; on phones too."""
    ends, size = np.log([axes.get_xlim(), axes.get_ylim()]), np.array([235, 190])  # a phone's, pt
    at = {k: (np.log(p) - ends[:, 0]) / np.ptp(ends, axis=1) * size for k, p in points.items()}
    taken = [np.array([place - 4, place + 4]) for place in at.values()]
    for name, place in at.items():
        wide = np.array([4.6 * len(name), 9])
        found: list[tuple[Any, ...]] = []
        for up, right in itertools.product((4, -12, 14, -22, 24), (1, -1)):
            low = place + (5 if right > 0 else -5 - wide[0], up)
            box = np.array([low, low + wide])
            hidden = sum((np.minimum(box[1], b[1]) > np.maximum(box[0], b[0])).all() for b in taken)
            outside = np.maximum(0, [-low, box[1] - size]).sum()
            found.append((hidden + outside, len(found), right, up, box))
        _, _, right, up, box = min(found, key=lambda each: each[:2])
        taken.append(box)
        where = points[name], (5 * right, up), "data", "offset points"
        axes.annotate(name, *where, fontsize=8, ha="left" if right > 0 else "right")


def length_unit(metres: float) -> tuple[str, float]:
    """The unit of lengths of this size, and how many of it a metre has; as in words."""
    return ("m", 1.0) if 100 * metres >= METRES_FROM else ("cm", 100.0)


def legend_above(axes: Axes, columns: int = 3) -> None:
    """A legend between the axes and whatever is above them, where no data are."""
    axes.legend(
        loc="lower left",
        bbox_to_anchor=(0, 1.0),
        ncols=columns,
        borderaxespad=0.2,
        columnspacing=1.4,
    )


def with_intervals(
    axes: Axes,
    places: np.ndarray,
    entries: Iterable[Mapping[str, float]],
    *,
    across: bool = False,
    scale: float = 1.0,
    **style: Any,
) -> None:
    """Marks with their intervals, as records hold them, at places along x.

    With `across` at places along y, the intervals across.
    """
    rows = np.array([[each["value"], each["low"], each["high"]] for each in entries], float)
    middle, low, high = scale * rows.T
    reach = np.maximum(np.abs([low - middle, high - middle]), 0)
    if across:
        axes.errorbar(middle, places, xerr=reach, **style)
    else:
        axes.errorbar(places, middle, yerr=reach, **style)


def label_rows(axes: Axes, labels: Collection[str], xlabel: str) -> None:
    """A line of the plot for each label, the first on top; values from zero on along x."""
    axes.set_yticks(range(len(labels)), labels=list(labels))
    axes.set(xlabel=xlabel, xlim=(0, None), ylim=(len(labels) - 0.5, -0.5))
    axes.grid(axis="y", visible=False)


def errors_by_row(
    rows: Mapping[str, str], errors: Mapping[str, Mapping[str, Mapping[str, float]]]
) -> Figure:
    """Mean errors in cm with their intervals, a line of the plot for each of `rows`.

    Parameters
    ----------
    rows : mapping
        Key to label.
    errors : mapping
        Method to entries, as records hold them, by the keys of those rows that it has.
    """
    with canvas(size=(7.2, 0.8 + 0.36 * len(rows))) as (figure, [[plot]]):
        for place, (method, found) in enumerate(errors.items()):
            at = np.array([row for row, key in enumerate(rows) if key in found])
            at = at + 0.14 * (place - (len(errors) - 1) / 2)
            shown = [found[key] for key in rows if key in found]
            mark: dict[str, Any] = {"fmt": "osD"[place], "color": COLORS[method], "markersize": 4}
            with_intervals(plot, at, shown, across=True, label=method, **mark)
        label_rows(plot, rows.values(), "mean error (cm)")
        least = min(line.get_xdata().min() for line in plot.lines)
        plot.set(xscale="log", xlim=(least / 2, None))
        plain_log_ticks(plot.xaxis)
        legend_above(plot)
    return figure


def heat_map(
    figure: Figure, axes: Axes, heat: np.ndarray, extent: Any, label: str, **bar: Any
) -> None:
    """``(rows, columns)`` values over a floor plan, row 0 at the smallest y, with their scale."""
    colors = axes.imshow(heat, extent=extent, origin="lower", cmap="YlOrRd", alpha=0.65, zorder=1)
    scale = figure.colorbar(colors, ax=axes, shrink=0.85, **bar)
    scale.set_label(label)
    scale.outline.set_visible(False)


def plain_log_ticks(*axes: Axis) -> None:
    """Numbers at 1, 2 and 5 times the powers of ten, written out, along logarithmic axes."""
    for axis in axes:
        axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.set_major_formatter("{x:g}")
        axis.set_minor_locator(NullLocator())


def legend_below(axes: Axes, drop: float, columns: int = 1) -> None:
    """A legend below the axes, by a share of their height that clears the label of x."""
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -drop), ncols=columns)


def label_ends(axes: Axes) -> None:
    """The label of each line at its end, in its colour, all clear of one another."""
    to_axes = axes.transData + axes.transAxes.inverted()
    ends = [(to_axes.transform(np.asarray(line.get_xydata())[-1])[1], line) for line in axes.lines]
    last = -np.inf
    for height, line in sorted(ends, key=lambda end: end[0]):
        last = max(height, last + 0.075)
        where = (1, last), (5, 0), "axes fraction", "offset points"
        label, color = str(line.get_label()), line.get_color()
        axes.annotate(label, *where, color=color, fontsize=9, va="center")
