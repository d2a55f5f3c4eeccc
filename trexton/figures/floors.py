"""The figure of a floor: where one will be off, and by how much."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.figures.style import COLORS, canvas, floor_axes
from trexton.simulator import Floor

__all__ = ["expected_errors"]


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
