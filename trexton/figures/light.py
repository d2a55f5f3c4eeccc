"""Figures of other light: error over drift and over white balance."""

from __future__ import annotations

import pandas as pd
from matplotlib.figure import Figure

from trexton.figures.style import COLORS, canvas, legend_above
from trexton.records import Record

__all__ = ["sweeps", "table"]

STYLE = {
    "paper": ("paper", COLORS["paper"], "o-"),
    "both": ("paper, agile", COLORS["paper"], "s--"),
    "field": ("field", COLORS["field"], "o-"),
}

LIGHTS = {"drift": "gain drifts by {:g} %", "warmth": "red gains and blue loses {:g} %"}


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
                short, color, stroke = STYLE[name]
                plot.plot(shares, errors, stroke, color=color, label=short)
            plot.set(xlabel=label, ylim=(0, None))
        axes[0, 0].set_ylabel("mean error (cm)")
        legend_above(axes[0, 0], 3)
    return figure


def table(record: Record) -> pd.DataFrame:
    """Mean error of each method (cm), a row for each light; the steady one first."""
    rows = [
        {"light": words.format(100 * share) if share else "steady"}
        | {STYLE[name][0]: f"{errors[i]:.0f}" for name, errors in series.items()}
        for what, words in LIGHTS.items()
        for series in (record.series[f"by_{what}_cm"],)
        for i, share in enumerate(record.series[what])
        if share or what == "drift"
    ]
    return pd.DataFrame(rows)
