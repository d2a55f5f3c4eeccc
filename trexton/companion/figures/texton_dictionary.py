"""Figures of the dictionary: the textons, how they were learned, where each occurs."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.style import SERIES, canvas, legend_below

__all__ = ["convergence", "labelled", "places", "textons"]

_NAMES = {"kohonen": "Kohonen network", "winner-take-all": "winner-take-all"}


def tiles(record: Record, name: str = "textons") -> list[np.ndarray]:
    """The textons as small RGB pictures, in the order of the dictionary."""
    return np.split(record.images[name][..., ::-1], record.parameters["textons"], axis=1)


def textons(record: Record) -> Figure:
    """Every texton and its frequency over the training flight."""
    frequency = 100 * np.array(record.values["frequency"])
    pictures, columns = tiles(record), min(10, len(frequency))
    rows = -(-len(pictures) // columns)
    with canvas(rows, columns, size=(7.2, 0.98 * rows)) as (figure, axes):
        for index, axis in enumerate(axes.flat):
            _bare(axis)
            if index < len(pictures):
                axis.imshow(pictures[index])
                axis.set_xlabel(f"{index}:  {frequency[index]:.1f} %", fontsize=8.5, labelpad=2)
    return figure


def convergence(record: Record) -> Figure:
    """Distance of patches to their nearest texton while the dictionary is learned."""
    with canvas(size=(6.4, 3.2)) as (figure, axes):
        plot = axes[0, 0]
        for (method, errors), color in zip(
            record.series["convergence"].items(), SERIES, strict=False
        ):
            seen = np.arange(1, len(errors) + 1) * record.values["patches"] / len(errors)
            final = record.values["methods"][method]
            label = f"{_NAMES[method]}: in the end {final['error']:.1f} over all patches"
            plot.plot(seen / 1000, errors, color=color, label=label, linewidth=1.1)
            plot.axhline(final["error"], color=color, linestyle=":", linewidth=1)
        plot.set(xlabel="patches seen (thousands)")
        plot.set(ylabel="RMS distance to the nearest\ntexton (grey levels)")
        plot.set(xlim=(0, record.values["patches"] / 1000), ylim=(0, None))
        legend_below(plot, 0.2)
    return figure


def places(record: Record) -> Figure:
    """Frequency of each texton over the floor, each on its own scale from zero to its largest."""
    maps = np.array(record.series["place_frequency"], dtype=float)
    pictures, columns = tiles(record), min(5, len(maps))
    rows = -(-len(maps) // columns)
    x_min, x_max, y_min, y_max = record.series["area_m"]
    height = 1.62 * rows * (y_max - y_min) / (x_max - x_min)
    with canvas(rows, columns, size=(7.2, min(height, 12)), sharex=True, sharey=True) as (
        figure,
        axes,
    ):
        for index, axis in enumerate(axes.flat):
            if index >= len(maps):
                axis.set_axis_off()
                continue
            top = np.nanmax(maps[index])
            extent = (x_min, x_max, y_min, y_max)
            axis.imshow(
                100 * maps[index],
                origin="lower",
                extent=extent,
                cmap="cividis",
                vmin=0,
                vmax=100 * top or 1,
                label="frequency (%)",
            )
            axis.set_facecolor("#eeeeee")
            axis.grid(False)
            axis.set_title(
                f"{index}   up to {100 * top:.2g} %", fontsize=8, loc="right", weight="normal"
            )
            icon = axis.inset_axes((0, 1.02, 0.16, 0.16))
            icon.imshow(pictures[index])
            _bare(icon)
        for axis in axes[-1]:
            axis.set_xlabel("x (m)")
        for axis in axes[:, 0]:
            axis.set_ylabel("y (m)")
    return figure


def labelled(record: Record) -> Figure:
    """A frame, and the same with every patch in the colour of its texton."""
    with canvas(1, 2, size=(7.2, 2.9)) as (figure, axes):
        for axis, name, title in zip(
            axes[0], ("frame", "labelled"), ("A frame", "Its textons"), strict=True
        ):
            axis.imshow(record.images[name][..., ::-1], interpolation="bilinear")
            axis.set_title(title)
            _bare(axis)
    return figure


def _bare(axes: Axes) -> None:
    axes.grid(False)
    axes.set(xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_visible(False)
