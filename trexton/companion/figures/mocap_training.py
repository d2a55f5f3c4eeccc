"""Figures of one track of estimates: floor plan, error over time, spread."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.style import (
    COLORS,
    canvas,
    floor_axes,
    legend_above,
    legend_below,
    length_unit,
    mean_line,
    show_floor,
)

__all__ = ["error_over_time", "floor_plan", "spread_over_time"]

_ROWS = (("knn", "k-NN alone", "neighbors"), ("estimate", "particle filter", "paper"))


def floor_plan(record: Record) -> Figure:
    """Truth and estimate over the floor."""
    series = record.series
    truth, estimate = np.array(series["truth_m"]), np.array(series["estimate_m"])
    with canvas(size=(5.4, 5.0)) as (figure, axes):
        plan = axes[0, 0]
        floor_axes(plan, series["area_m"])
        show_floor(plan, series.get("floor"), record.images.get("floor"))
        # Every fifth frame: where the estimate was against the truth.
        for start in range(0, len(truth), 5):
            plan.plot(
                *zip(truth[start], estimate[start], strict=True),
                color=COLORS["paper"],
                linewidth=0.5,
                alpha=0.6,
            )
        plan.plot(*truth.T, color=COLORS["truth"], linewidth=2, label="motion capture")
        plan.plot(
            *estimate[::5].T,
            "o",
            color=COLORS["paper"],
            markersize=3,
            label="estimate (every 5th frame)",
        )
        legend_below(plan, 0.12, columns=2)
    return figure


def error_over_time(record: Record) -> Figure:
    """Absolute error in x and y over the flight, of filter and k-NN alone, with their means."""
    series = record.series
    time, truth = np.array(series["time_s"]), np.array(series["truth_m"])
    errors = {key: np.abs(np.array(series[f"{key}_m"]) - truth) for key, _, _ in _ROWS}
    unit, scale = length_unit(min(error.mean() for error in errors.values()))
    with canvas(2, 1, size=(7.2, 4.2), sharex=True, sharey=True) as (figure, axes):
        for axis, name in enumerate("xy"):
            plot = axes[axis, 0]
            for key, label, color in _ROWS:
                error = scale * errors[key][:, axis]
                plot.plot(time, error, color=COLORS[color], label=label, linewidth=1.0)
                mean_line(plot, error, COLORS[color], unit)
            plot.set_ylabel(f"error in {name} ({unit})")
        axes[0, 0].set_ylim(0, None)
        legend_above(axes[0, 0])
        axes[1, 0].set_xlabel("time (s)")
    return figure


def spread_over_time(record: Record) -> Figure:
    """Standard deviation of the particles in x and y over the flight."""
    series = record.series
    time, spread = np.array(series["time_s"]), np.array(series["spread_m"])
    unit, scale = length_unit(float(spread.mean()))
    with canvas(size=(7.2, 2.4)) as (figure, axes):
        for axis, (name, style) in enumerate((("x", "-"), ("y", ":"))):
            look: dict[str, Any] = {
                "color": COLORS["particles"],
                "linestyle": style,
                "linewidth": 1.2,
            }
            axes[0, 0].plot(time, scale * spread[:, axis], label=f"spread in {name}", **look)
        axes[0, 0].set(xlabel="time (s)", ylabel=f"particle spread ({unit})", ylim=(0, None))
        legend_above(axes[0, 0])
    return figure
