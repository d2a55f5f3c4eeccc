"""Figures of the stitched map: the flight over it, and where it deviates from the true floor."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.style import SERIES, canvas, floor_axes, legend_below, show_floor

__all__ = ["deviation", "stitched"]


def stitched(record: Record) -> Figure:
    """The mosaic, the frames' true positions and the few that placed it in the world."""
    series = record.series
    frames, anchors = np.array(series["frames_m"]), np.array(series["anchors_m"])
    with canvas(size=(6.2, 6.4)) as (figure, axes):
        plan = axes[0, 0]
        floor_axes(plan, series["area_m"])
        show_floor(plan, series["map"], record.images["map"], fade=1.0)
        plan.plot(*frames.T, color="white", linewidth=0.7, alpha=0.8)
        dots: dict[str, Any] = {
            "color": SERIES[1],
            "markeredgecolor": "white",
            "markersize": 6,
        }
        plan.plot(*anchors.T, "o", **dots, label="frames that place it")
        legend_below(plan, 0.1)
    return figure


def deviation(record: Record, magnified: float = 20.0) -> Figure:
    """Arrows from true places to where the mosaic shows them, lengthened `magnified` times."""
    series = record.series
    places, offsets = np.array(series["residual_at_m"]), np.array(series["residual_m"])
    with canvas(size=(6.2, 6.2)) as (figure, axes):
        plan = axes[0, 0]
        floor_axes(plan, series["area_m"])
        show_floor(plan, series["map"], record.images["map"], fade=0.35)
        length = 100 * np.hypot(*offsets.T)
        as_long: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.004}
        as_long["label"] = "deviation (cm)"
        arrows = plan.quiver(*places.T, *(magnified * offsets.T), length, cmap="viridis", **as_long)
        # A mismatch or two on a tiled mat must not set the scale.
        arrows.set_clim(0, np.percentile(length, 98))
        figure.colorbar(
            arrows,
            ax=plan,
            label=f"deviation (cm); arrows {magnified:.0f} times as long",
            shrink=0.7,
            extend="max",
        )
    return figure
