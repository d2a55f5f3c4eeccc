"""Figures of what lies beyond the paper: errors, lag, expected error."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.beyond import VARIANTS
from trexton.companion.experiments.style import COLORS, canvas, legend_above

__all__ = ["errors", "expected_error", "lag"]

_STROKES = {
    "agile": ":", "narrow": "--", "both": "-.",
    "field_particles": ":", "field_whole": "--",
    "field_camera": "-.", "field_odometry": (0, (5, 1, 1, 1, 1, 1)),
}  # fmt: skip


def errors(record: Record) -> Figure:
    """Share of frames that err by less, of every variant."""
    with canvas(size=(7.2, 3.6)) as (figure, axes):
        plot = axes[0, 0]
        for name, values in record.series["errors_cm"].items():
            share = (np.arange(len(values)) + 0.5) / len(values)
            plot.plot(
                values, 100 * share, color=COLORS["field" if name.startswith("field") else "paper"],
                linestyle=_STROKES.get(name, "-"), label=VARIANTS[name].label,
            )  # fmt: skip
        plot.set(
            xscale="log", xlim=(1, None), ylim=(0, 100),
            xlabel="error (cm)", ylabel="frames that err by less (%)",
        )  # fmt: skip
        plot.xaxis.set_major_formatter("{x:g}")
        legend_above(plot, 2)
    return figure


def lag(record: Record) -> Figure:
    """Mean error of the paper's filter if its estimates were as late as drawn."""
    series = record.series["lag"]
    with canvas(size=(7.2, 2.8)) as (figure, axes):
        plot = axes[0, 0]
        plot.plot(series["shift_s"], series["error_cm"], color=COLORS["paper"])
        plot.set(
            xlabel="estimate compared with where the vehicle was so many seconds before (s)",
            ylabel="mean error (cm)", ylim=(0, None), xlim=(0, None),
        )  # fmt: skip
    return figure


def expected_error(record: Record) -> Figure:
    """Error of each frame over what was expected at its place before the flight."""
    expected = np.array(record.series["expected_cm"])
    error = np.array(record.series["field_error_cm"])
    order = np.argsort(expected, kind="stable")
    with canvas(size=(5.4, 3.6)) as (figure, axes):
        plot = axes[0, 0]
        plot.plot(expected, error, ".", color=COLORS["zone"], markersize=3, alpha=0.5)
        parts = np.array_split(order, 8)
        plot.plot(
            [expected[part].mean() for part in parts], [error[part].mean() for part in parts],
            "o-", color=COLORS["field"], label="mean of an eighth of the frames",
        )  # fmt: skip
        edge = float(max(expected.max(), np.percentile(error, 97)))
        plot.plot([0, edge], [0, edge], color=COLORS["truth"], linestyle="--", label="as expected")
        plot.set(xlim=(0, edge), ylim=(0, edge), xlabel="expected error (cm)", ylabel="error (cm)")
        legend_above(plot, 2)
    return figure
