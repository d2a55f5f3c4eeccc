"""Figures of the homography baseline: its fixes on the map, and how its errors are distributed."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.style import (
    COLORS,
    canvas,
    floor_axes,
    legend_above,
    legend_below,
    show_floor,
)
from trexton.evaluation.metrics import euclidean

__all__ = ["MAPS", "error_distribution", "fixes"]

# place in the record: label and stroke
MAPS = {
    "mosaic": ("on the stitched map", "-"),
    "perfect_floor": ("on the true floor", ":"),
    "drifting": ("on a drifting map", "--"),
}


def fixes(record: Record) -> Figure:
    """The fixes on the stitched map, each joined to the true position; crosses without a fix."""
    series = record.series
    color = COLORS["homography"]
    truth, position = np.array(series["truth_m"]), np.array(series["mosaic_m"], dtype=float)
    lost = ~np.isfinite(position).all(axis=1)
    with canvas(size=(5.6, 5.6)) as (figure, axes):
        plan = axes[0, 0]
        floor_axes(plan, series["area_m"])
        show_floor(plan, series["map"], record.images["map"])
        for true, found in zip(truth[~lost], position[~lost], strict=True):
            plan.plot(*zip(true, found, strict=True), color=color, linewidth=0.6, alpha=0.6)
        plan.plot(*truth.T, color=COLORS["truth"], linewidth=1.6, label="motion capture")
        plan.plot(*position[~lost].T, ".", color=color, markersize=3, label="homography")
        if lost.any():
            label = f"no homography ({lost.sum()})"
            plan.plot(*truth[lost].T, "x", color=color, label=label)
        legend_below(plan, 0.11, columns=3)
    return figure


def error_distribution(record: Record) -> Figure:
    """Share of all frames whose error is at most so large; frames without a fix never count."""
    truth = np.array(record.series["truth_m"])
    with canvas(size=(7.2, 3.2)) as (figure, axes):
        plot = axes[0, 0]
        for name, (label, stroke) in MAPS.items():
            if f"{name}_m" not in record.series:
                continue
            error = 100 * euclidean(np.array(record.series[f"{name}_m"], dtype=float), truth)
            error = np.sort(error[np.isfinite(error)])
            share = 100 * np.arange(1, len(error) + 1) / len(truth)
            color = COLORS["homography"]
            plot.step(error, share, where="post", color=color, linestyle=stroke, label=label)
        plot.set(
            xscale="log", xlabel="Euclidean error (cm)", ylabel="share of frames (%)", ylim=(0, 102)
        )
        plot.xaxis.set_major_formatter("{x:g}")
        legend_above(plot)
    return figure
