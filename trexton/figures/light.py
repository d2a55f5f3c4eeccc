"""Figures of other light: error over drift and over white balance."""

from __future__ import annotations

from matplotlib.figure import Figure

from trexton.figures.style import COLORS, canvas, legend_above
from trexton.records import Record

__all__ = ["sweeps"]

STYLE = {
    "paper": ("paper", COLORS["paper"]),
    "both": ("paper, agile", COLORS["knn"]),
    "field": ("field", COLORS["estimate"]),
}


def sweeps(record: Record) -> Figure:
    """Mean error of each method over the drift of the gain, and over the white balance."""
    series = record.series
    with canvas(1, 2, size=(7.2, 3.2), sharey=True) as (figure, axes):
        for plot, what, label in (
            (axes[0, 0], "drift", "drift of the gain (%)"),
            (axes[0, 1], "warmth", "white balance (%)"),
        ):
            shares = [100 * share for share in series[what]]
            for name, errors in series[f"by_{what}_cm"].items():
                short, color = STYLE[name]
                plot.plot(shares, errors, "o-", color=color, label=short)
            plot.set(xlabel=label, ylim=(0, None))
        axes[0, 0].set_ylabel("mean error (cm)")
        legend_above(axes[0, 0], 3)
    return figure
