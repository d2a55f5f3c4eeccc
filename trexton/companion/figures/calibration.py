"""Figures of what an uncertainty is worth: error against claim, and regions by quarter."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from trexton.base.records import Record
from trexton.companion.experiments.calibration import METHODS
from trexton.companion.experiments.style import COLORS, canvas, legend_above

__all__ = ["error_against_claim", "regions_by_quarter"]


def error_against_claim(record: Record) -> Figure:
    """Tenths of the frames by what was claimed; on the diagonal the claim is honest."""
    with canvas(size=(5.6, 4.6)) as (figure, axes):
        plot = axes[0, 0]
        ends = []
        for name in record.values["order"]:
            groups = record.series[name]
            claimed = [group["claimed_cm"] for group in groups]
            error = [group["error_cm"] for group in groups]
            plot.plot(claimed, error, "o-", color=COLORS[name], markersize=4, label=METHODS[name])
            ends += [value for value in (*claimed, *error) if value > 0]
        both = [min(ends), max(ends)]
        plot.plot(both, both, color=COLORS["truth"], linewidth=0.9, linestyle="--")
        plot.set(
            xlabel="deviation claimed along an axis (cm)",
            ylabel="error along an axis (cm)",
            xscale="log",
            yscale="log",
        )
        for axis in (plot.xaxis, plot.yaxis):
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(NullFormatter())
        legend_above(plot)
    return figure


def regions_by_quarter(record: Record) -> Figure:
    """Share of the truth inside the 90 % regions in each quarter of the flight, and where chance
    alone puts honest ones.
    """
    with canvas(size=(6.4, 3.2)) as (figure, axes):
        plot = axes[0, 0]
        order = record.values["order"]
        width = 0.8 / len(order)
        for place, name in enumerate(order):
            shares = 100 * np.array(record.values[name]["quarters"])
            at = np.arange(len(shares)) + (place - (len(order) - 1) / 2) * width
            plot.bar(at, shares, width, color=COLORS[name], label=METHODS[name])
            if (chance := record.values[name]["chance"]) is not None:
                low, high = 100 * chance["low"], 100 * chance["high"]
                plot.vlines(at, low, high, color=COLORS["truth"], linewidth=1.5)
        plot.axhline(90, color=COLORS["truth"], linewidth=0.9, linestyle="--")
        plot.set_xticks(range(4), ["first quarter", "second", "third", "last"])
        plot.set(ylabel="truth in the 90 % region (%)", ylim=(0, 100))
        plot.grid(axis="x", visible=False)
        legend_above(plot)
    return figure
