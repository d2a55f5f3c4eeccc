"""Figures of the assessment: where it was off, and how often by how much."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.style import (
    COLORS,
    canvas,
    floor_axes,
    legend_above,
    length_unit,
    show_floor,
)
from trexton.evaluation.metrics import euclidean

__all__ = ["LABELS", "error_shares", "over_the_floor"]

# name: what it is called, and its colour
LABELS = {
    "paper": ("the paper's filter", "paper"),
    "guarded": ("guarded", "guarded"),
    "field": ("field", "field"),
    "fine": ("fine", "fine"),
    "knn": ("neighbours alone", "neighbors"),
    "centre": ("always the centre", "zone"),
    "shuffled": ("shuffled neighbours", "neighbors"),
}


def _unit(record: Record) -> tuple[str, float]:
    """What errors are told in, and how many of it a metre has: as the record's words do."""
    best = min(entry["mean_cm"]["value"] for entry in record.values["errors"].values())
    return length_unit(best / 100)


def over_the_floor(record: Record) -> Figure:
    """The truth, and the best method's estimates joined to it, over the error to expect."""
    series, errors = record.series, record.values["errors"]
    methods = record.parameters["methods"].split()
    best = min(methods, key=lambda name: errors[name]["mean_cm"]["value"])
    truth, estimate = np.array(series["truth_m"]), np.array(series[f"{best}_m"])
    label, color = LABELS[best]
    with canvas(size=(6.2, 5.2)) as (figure, axes):
        plan = axes[0, 0]
        floor_axes(plan, series["area_m"])
        show_floor(plan, series.get("floor"), record.images.get("floor"), fade=0.3)
        if "expected" in series:
            unit, scale = _unit(record)
            heat = scale * np.array(series["expected"]["error_m"], dtype=float)
            colors = plan.imshow(
                heat, extent=series["expected"]["extent_m"], origin="lower", cmap="YlOrRd",
                alpha=0.65, zorder=1,
            )  # fmt: skip
            bar = figure.colorbar(colors, ax=plan, shrink=0.85)
            bar.set_label(f"expected error ({unit})")
            bar.outline.set_visible(False)
        for true, guess in zip(truth[::5], estimate[::5], strict=True):
            plan.plot(*zip(true, guess, strict=True), color=COLORS[color], linewidth=0.6)
        plan.plot(*truth.T, color=COLORS["truth"], linewidth=1.6, label="true track")
        plan.plot(
            *estimate[::5].T,
            "o",
            color=COLORS[color],
            markersize=3,
            label=f"{label}, every 5th frame",
        )
        legend_above(plan)
    return figure


def error_shares(record: Record) -> Figure:
    """Cumulated shares of the errors: a line further to the left is better."""
    series, truth = record.series, np.array(record.series["truth_m"])
    unit, scale = _unit(record)
    names = [*record.parameters["methods"].split(), "knn", "centre", "shuffled"]
    with canvas(size=(7.2, 3.4)) as (figure, axes):
        plot = axes[0, 0]
        for name in names:
            label, color = LABELS[name]
            error = scale * np.sort(euclidean(np.array(series[f"{name}_m"]), truth))
            share = 100 * np.arange(1, len(error) + 1) / len(error)
            plot.step(
                error, share, where="post", color=COLORS[color], label=label,
                linestyle="--" if name in ("centre", "shuffled") else "-",
            )  # fmt: skip
        plot.set(xlabel=f"error ({unit})", ylabel="frames below it (%)", ylim=(0, 100))
        plot.set_xlim(0, None)
        legend_above(plot)
    return figure
