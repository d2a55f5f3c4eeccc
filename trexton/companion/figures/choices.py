"""The figure of the open choices: one line a choice, its error with its interval."""

from __future__ import annotations

from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.style import COLORS, canvas

__all__ = ["costs"]


def costs(record: Record) -> Figure:
    """Mean error of every variant with its 95 % interval; the line is the paper's method."""
    variants = [record.values["variants"][key] for key in record.values["order"]]
    with canvas(size=(7.2, 0.7 + 0.3 * len(variants))) as (figure, axes):
        plot = axes[0, 0]
        for row, variant in enumerate(reversed(variants)):
            error = variant["mean_cm"]
            color = COLORS["paper" if variant["group"] == "paper" else "zone"]
            plot.plot(
                [error["low"], error["high"]], [row, row], color=color, linewidth=2.2, alpha=0.55
            )
            code = variant.get("flight_code", False)
            face = color if code or variant["group"] == "paper" else "white"
            plot.plot(error["value"], row, "o", color=color, markerfacecolor=face, markersize=5)
        plot.axvline(
            variants[0]["mean_cm"]["value"],
            color=COLORS["paper"],
            linewidth=0.9,
            linestyle="--",
        )
        plot.set_yticks(range(len(variants)), [variant["label"] for variant in reversed(variants)])
        plot.set(xlabel="mean distance to the truth (cm)", xlim=(0, None))
        plot.grid(axis="y", visible=False)
    return figure
