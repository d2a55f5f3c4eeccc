"""Figures of being carried away: when the vehicle is found, its error, when it says "lost"."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.style import COLORS, canvas, legend_above

__all__ = ["error_since", "lost_told", "time_to_recover"]

_FILTERS = {
    "plain": ("the paper's filter", COLORS["paper"], "-"),
    "augmented": ("with random particles", COLORS["guarded"], "--"),
    "field": ("the field", COLORS["field"], "-."),
}


def time_to_recover(record: Record) -> Figure:
    """Share of the kidnappings after which the vehicle has been found again, over time."""
    counts, patience = record.values["counts"], record.values["patience_s"]
    with canvas(size=(6.4, 3.4)) as (figure, axes):
        plot = axes[0, 0]
        for name, (label, color, style) in _FILTERS.items():
            times = np.array(record.series[name]["recovery_s"])
            found = 100 * np.arange(1, len(times) + 1) / counts["kidnappings"]
            plot.step(
                [0, *times, patience],
                [0, *found, found[-1] if len(found) else 0],
                where="post",
                color=color,
                linestyle=style,
                label=label,
            )
        plot.set(
            xlabel="time since the kidnapping (s)",
            ylabel="found again (%)",
            xlim=(0, patience),
            ylim=(0, 102),
        )
        legend_above(plot)
    return figure


def error_since(record: Record) -> Figure:
    """Median error after a kidnapping with the range of four fifths, and the share called lost."""
    time = np.array(record.series["time_s"])
    with canvas(2, 1, size=(6.4, 4.8), sharex=True, height_ratios=(3, 2)) as (figure, axes):
        error, lost = axes[:, 0]
        for name, (label, color, style) in _FILTERS.items():
            band = {key: np.array(values) for key, values in record.series[name]["error_m"].items()}
            error.fill_between(
                time, band["low"], band["high"], color=color, alpha=0.15, linewidth=0
            )
            error.plot(time, band["median"], color=color, linestyle=style, label=label)
            share = 100 * np.array(record.series[name]["lost"])
            lost.plot(time, share, color=color, linestyle=style)
        error.axhline(
            record.parameters["tolerance"],
            color=COLORS["truth"],
            linestyle=":",
            label="counts as found",
        )
        error.set(ylabel="error (m)", ylim=(0, None))
        lost.set(
            xlabel="time since the kidnapping (s)",
            ylabel="called lost (%)",
            ylim=(0, None),
            xlim=(0, time[-1]),
        )
        legend_above(error)
    return figure


def lost_told(record: Record) -> Figure:
    """What a width of the cloud, taken as "lost", tells of wrong frames and of calm ones; and the
    field's own word."""
    series, values = record.series["augmented"], record.values["augmented"]
    shares, told, nothing = (
        100 * np.array(column, dtype=float)
        for column in (record.series["shares"], series["told"], series["for_nothing"])
    )
    with canvas(size=(6.4, 3.6)) as (figure, axes):
        plot = axes[0, 0]
        plot.plot(
            nothing,
            told,
            color=COLORS["guarded"],
            marker="o",
            markersize=4,
            label="the cloud's width alone",
        )
        for share in (30, 50):  # above the curve, where nothing else is
            at = int(np.argmin(np.abs(shares - share)))
            if nothing[at] > 50:
                continue
            plot.annotate(
                f"{share} %",
                (nothing[at], told[at]),
                xytext=(-5, 5),
                textcoords="offset points",
                ha="right",
                fontsize=9,
            )
        for point, label, color, marker in (
            (values["lost_by_fit"], "the filter's fit alone", COLORS["guarded"], "D"),
            (values["lost"], "both, as on board", COLORS["guarded"], "s"),
            (record.values["field"]["lost"], "the field", COLORS["field"], "^"),
        ):
            if point["wrong_frames_rate"] is not None:
                plot.plot(
                    100 * point["calm_frames_rate"],
                    100 * point["wrong_frames_rate"],
                    marker,
                    color=color,
                    markersize=8,
                    markeredgecolor="white",
                    label=label,
                )
        plot.set(
            xlabel="of undisturbed frames called lost (%)",
            ylabel="of wrong frames called lost (%)",
            xlim=(-1, 50),
            ylim=(-2, 102),
        )
        legend_above(plot)
    return figure
