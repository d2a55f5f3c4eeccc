"""Figures of training on homography positions: their errors, and what the filter makes of them."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.style import COLORS, canvas, legend_above

__all__ = ["ROWS", "estimate_errors", "training_errors"]

# place in the record: label and colour; both train the paper's filter, one as the paper does
ROWS = {
    "filter": ("homography positions", COLORS["paper"]),
    "remedy": ("filtered first", COLORS["guarded"]),
}


def training_errors(record: Record) -> Figure:
    """Error of each training position, as the homography gives it and after filtering, by frame."""
    with canvas(2, 1, size=(7.2, 4.2), sharex=True) as (figure, axes):
        for axis, name in enumerate("xy"):
            plot = axes[axis, 0]
            for key, (label, color) in ROWS.items():
                error = (
                    100 * np.array(record.series[f"{key}_training_error_m"], dtype=float)[:, axis]
                )
                plot.plot(np.maximum(error, 0.1), ".", color=color, markersize=4, label=label)
            plot.set(yscale="log", ylabel=f"error in {name} (cm)")
            plot.yaxis.set_major_formatter("{x:g}")
        legend_above(axes[0, 0], 2)
        axes[1, 0].set_xlabel("training frame")
    return figure


def estimate_errors(record: Record) -> Figure:
    """Absolute error of the localizer over the test flight, trained on either set of positions."""
    series = record.series
    time, truth = np.array(series["time_s"]), np.array(series["truth_m"])
    with canvas(2, 1, size=(7.2, 4.2), sharex=True, sharey=True) as (figure, axes):
        for axis, name in enumerate("xy"):
            plot = axes[axis, 0]
            for key, (label, color) in ROWS.items():
                error = 100 * np.abs(
                    np.array(series[f"{key}_estimate_m"])[:, axis] - truth[:, axis]
                )
                plot.plot(time, error, color=color, label=f"trained on {label}", linewidth=1.0)
            plot.set_ylabel(f"error in {name} (cm)")
        axes[0, 0].set_ylim(0, None)
        legend_above(axes[0, 0], 2)
        axes[1, 0].set_xlabel("time (s)")
    return figure
