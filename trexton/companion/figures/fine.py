"""Figures of coarse to fine: errors of the recorded flight, errors over floors, claimed regions."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.style import COLORS, canvas, legend_above

__all__ = ["coverage", "over_floors", "over_time"]

_KINDS = {
    "attitude": ("with attitude", COLORS["fine"], "-"),
    "askew": ("with attitude askew", COLORS["field"], "-."),
    "free": ("without", COLORS["zone"], "--"),
}


def over_time(record: Record) -> Figure:
    """Error over the recorded flight, on the surveyed map above and on the stitched one below."""
    time = np.array(record.series["time_s"])
    with canvas(2, 1, size=(7.2, 4.4), sharex=True, sharey=True) as (figure, axes):
        for plot, where in zip(axes[:, 0], ("surveyed", "stitched"), strict=True):
            for name in ("attitude", "free"):  # askew would lie upon the first
                label, color, style = _KINDS[name]
                error = np.array(record.series[f"{where}_{name}_cm"], dtype=float)
                plot.plot(time, error, color=color, linestyle=style, linewidth=1.0, label=label)
            plot.set(ylabel=f"{where} map:\nerror (cm)", ylim=(0, None))
        legend_above(axes[0, 0])
        axes[1, 0].set(xlabel="time (s)", xlim=(0, time[-1]))
    return figure


def over_floors(*records: Record) -> Figure:
    """Share of frames with at most so large an error, over all floors; later records paler."""
    with canvas(size=(6.4, 3.4)) as (figure, axes):
        plot = axes[0, 0]
        for record, pale in zip(records, (1.0, 0.4), strict=False):
            for name, (label, color, style) in _KINDS.items():
                series: dict[str, Any] = record.series["errors_cm"][name]
                frames = record.values["all"][name]["frames"]
                plot.plot(
                    series["error"], series["share"], color=color, linestyle=style, alpha=pale,
                    label=f"{label}, {frames:,} frames",
                )  # fmt: skip
        plot.set(xlabel="error (cm)", ylabel="frames (%)", xscale="log", ylim=(0, 101))
        plot.xaxis.set_major_formatter("{x:g}")
        legend_above(plot, columns=2)
    return figure


def coverage(*records: Record) -> Figure:
    """How often a region that claims to hold the truth so often does; later records paler."""
    with canvas(size=(4.4, 4.0)) as (figure, axes):
        plot = axes[0, 0]
        plot.plot([0, 100], [0, 100], color=COLORS["truth"], linestyle=":", label="as claimed")
        for record, pale in zip(records, (1.0, 0.4), strict=False):
            for name, (label, color, style) in _KINDS.items():
                series = record.series["coverage"][name]
                claimed, held = (100 * np.array(series[key]) for key in ("claimed", "held"))
                plot.plot(
                    claimed, held, color=color, linestyle=style, alpha=pale,
                    label=label if pale == 1 else None,
                )  # fmt: skip
        plot.set(
            xlabel="claimed (%)", ylabel="holds the truth (%)", xlim=(0, 100), ylim=(0, 100),
            aspect="equal",
        )  # fmt: skip
        legend_above(plot, columns=2)
    return figure
