"""Figures of floors: where one will be off, and whether what is predicted comes true."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.figures.style import COLORS, canvas, floor_axes
from trexton.simulator import Floor

__all__ = ["expected_errors", "predicted_and_measured"]


def expected_errors(floor: Floor, judged: dict[str, Any]) -> Figure:
    """The error to expect at every place, over the floor's picture."""
    heat = 100 * np.array(judged["heat"]["error_m"], dtype=float)
    extent = judged["area_m"]
    with canvas(1, 1, size=(5.6, 5.0)) as (figure, axes):
        plan = axes[0, 0]
        floor_axes(plan, extent)
        pale = 255 - (255 - floor.picture.image[..., ::-1].astype(float)) * 0.35
        plan.imshow(pale.astype(np.uint8), extent=extent, interpolation="bilinear", zorder=0)
        colors = plan.imshow(
            heat, extent=extent, origin="lower", cmap="YlOrRd", alpha=0.7, zorder=1
        )
        x, y = judged["worst_m"]
        plan.plot(x, y, "x", color=COLORS["truth"], markersize=8)
        plan.annotate("hardest", (x, y), xytext=(6, 6), textcoords="offset points")
        bar = figure.colorbar(colors, ax=plan, shrink=0.85)
        bar.set_label("expected error (cm)")
        bar.outline.set_visible(False)
    return figure


def predicted_and_measured(rows: list[dict[str, Any]]) -> Figure:
    """A point a floor: the error expected from the survey alone, and the one then measured."""
    predicted = np.array([row["predicted_cm"] for row in rows])
    measured = [next(iter(row["measured"].values())) for row in rows]
    mean, low, high = (
        np.array([entry[key] for entry in measured]) for key in ("mean_cm", "low", "high")
    )
    with canvas(1, 1, size=(5.6, 4.6)) as (figure, axes):
        plot = axes[0, 0]
        most = 1.1 * max(predicted.max(), high.max())
        plot.plot([0, most], [0, most], color=COLORS["truth"], linewidth=0.8)
        for layout in dict.fromkeys(row["floor"].partition(":")[0] for row in rows):
            own = np.array([row["floor"].partition(":")[0] == layout for row in rows])
            plot.errorbar(
                predicted[own], mean[own], [(mean - low)[own], (high - mean)[own]], fmt="o",
                markersize=4, elinewidth=0.8, label=layout,
            )  # fmt: skip
        plot.set(
            xlabel="expected error (cm)",
            ylabel="measured error (cm)",
            xlim=(0, most),
            ylim=(0, most),
        )
        plot.legend(loc="upper left", title="floor")
    return figure
