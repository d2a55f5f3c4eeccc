"""Figures of other light: error over drift and over white balance."""

from __future__ import annotations

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.style import COLORS, canvas, legend_above
from trexton.companion.wording import distance

__all__ = ["sweeps", "table"]

STYLE = {
    "paper": ("paper", COLORS["paper"], "o-"),
    "both": ("paper, agile", COLORS["paper"], "s--"),
    "field": ("field", COLORS["field"], "o-"),
}

LIGHTS = {"drift": "gain drifts by {:g} %", "warmth": "red gains and blue loses {:g} %"}


def sweeps(record: Record) -> Figure:
    """Mean error of each method with its interval over the drift of the gain, and over the white
    balance.
    """
    series = record.series
    with canvas(1, 2, size=(7.2, 3.2), sharey=True) as (figure, axes):
        for plot, what, label in (
            (axes[0, 0], "drift", "drift of the gain (%)"),
            (axes[0, 1], "warmth", "white balance (%)"),
        ):
            shares = 100 * np.array(series[what])
            for place, (name, errors) in enumerate(series[f"by_{what}_cm"].items()):
                short, color, stroke = STYLE[name]
                mean = np.array([error["value"] for error in errors])
                ends = np.array([[error["low"], error["high"]] for error in errors]).T
                plot.errorbar(  # beside one another, so that no bar hides another
                    shares + 0.012 * (place - 1) * shares.max(), mean, yerr=np.abs(ends - mean),
                    fmt=stroke, color=color, elinewidth=1, label=short,
                )  # fmt: skip
            plot.set(xlabel=label, ylim=(0, None))
        axes[0, 0].set_ylabel("mean error (cm)")
        legend_above(axes[0, 0], 3)
    return figure


def table(record: Record) -> pd.DataFrame:
    """Mean error of each method with its interval, a row for each light; the steady one first."""
    rows = [
        {"light": words.format(100 * share) if share else "steady"}
        | {STYLE[name][0]: distance(errors[i]) for name, errors in series.items()}
        for what, words in LIGHTS.items()
        for series in (record.series[f"by_{what}_cm"],)
        for i, share in enumerate(record.series[what])
        if share or what == "drift"
    ]
    return pd.DataFrame(rows)
