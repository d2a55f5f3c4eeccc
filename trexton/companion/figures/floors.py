"""Figures of floors: where one will be off over one of them, and what was foretold of many."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator, ScalarFormatter

from trexton.companion.experiments.style import COLORS, canvas, floor_axes, legend_above
from trexton.simulator import Floor

__all__ = ["expected_errors", "foretold"]

Rows = Mapping[str, Mapping[str, float]]


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


def foretold(rows: Rows, kept: Rows) -> Figure:
    """Measured error over the predicted one, and over the paper's loss; `kept` floors open."""
    with canvas(1, 2, size=(7.2, 3.4), sharey=True) as (figure, axes):
        for points, face in ((kept, "none"), (rows, None)):
            for painted, marker, label in ((True, "o", "painted"), (False, "s", "photograph")):
                some = [row for name, row in points.items() if (":" in name) == painted]
                measured = [row["field_cm"] for row in some]
                for plot, key in ((axes[0, 0], "predicted_cm"), (axes[0, 1], "loss")):
                    if some:
                        plot.plot(
                            [row[key] for row in some], measured, marker,
                            color=COLORS["field"], markerfacecolor=face, markersize=5,
                            label=f"{label}, long run" if face else label,
                        )  # fmt: skip
        both = [row[key] for row in (*rows.values(), *kept.values())
                for key in ("predicted_cm", "field_cm")]  # fmt: skip
        ends = [min(both) / 1.2, max(both) * 1.2]
        axes[0, 0].plot(ends, ends, color=COLORS["truth"], linewidth=0.8, zorder=0)
        axes[0, 0].set(
            xscale="log", yscale="log", xlim=ends, ylim=ends,
            xlabel="foretold error (cm)", ylabel="measured error (cm)",
        )  # fmt: skip
        for axis in (axes[0, 0].xaxis, axes[0, 0].yaxis, axes[0, 1].yaxis):
            axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            axis.set_major_formatter(ScalarFormatter())
            axis.set_minor_locator(NullLocator())
        axes[0, 1].set_xlabel("the paper's loss")
        legend_above(axes[0, 0], 2)
    return figure
