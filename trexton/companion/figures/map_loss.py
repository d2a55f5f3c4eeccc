"""Figures of the map evaluation: loss and error over the floor, what the loss foretells."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.style import (
    COLORS,
    SERIES,
    canvas,
    floor_axes,
    legend_below,
    length_unit,
    show_floor,
)

__all__ = ["errors_by_loss", "heat_maps", "sigma_sweep", "similarity_by_distance"]


def heat_maps(record: Record) -> Figure:
    """The smoothed loss over the floor, and beside it the smoothed error of the k-NN."""
    heat, positions = record.series["heat"], np.array(record.series["positions_m"])
    unit, scale = length_unit(float(np.median(record.series["error_m"])))
    panels = (("Loss", "loss", 1, ""), ("Error of the k-NN alone", "error_m", scale, f" ({unit})"))
    with canvas(1, 2, size=(7.2, 4.0), sharey=True) as (figure, axes):
        for plan, (title, key, scale, unit) in zip(axes[0], panels, strict=True):
            floor_axes(plan, record.series["area_m"])
            show_floor(plan, record.series.get("floor"), record.images.get("floor"), fade=0.3)
            values = scale * np.array(heat[key], dtype=float)
            colors = plan.imshow(
                values, extent=heat["extent_m"], origin="lower", cmap="YlOrRd", alpha=0.75, zorder=1
            )
            plan.plot(*positions.T, ".", color=COLORS["truth"], markersize=1.2, alpha=0.6)
            plan.set_title(title)
            bar = figure.colorbar(colors, ax=plan, location="bottom", shrink=0.9, aspect=25)
            bar.set_label(f"smoothed {key.removesuffix('_m')}{unit}")
            bar.outline.set_visible(False)
        axes[0, 1].set_ylabel("")
    return figure


def errors_by_loss(record: Record) -> Figure:
    """Mean error in tenths of the frames, ordered by loss: foretelling gives rising lines."""
    lines = (
        ("train_knn", "training frames, k-NN without the frame", COLORS["neighbors"], "o--"),
        ("test_knn", "test flight, k-NN", COLORS["neighbors"], "s-"),
        ("test_filter", "test flight, particle filter", COLORS["paper"], "^-"),
    )
    unit, scale = length_unit(float(np.median(record.series["error_m"])))
    with canvas(size=(6.4, 3.6)) as (figure, axes):
        plot = axes[0, 0]
        for key, label, color, stroke in lines:
            rows = record.series["groups"][key]
            # A tenth of very few frames may hold none: its numbers are missing.
            loss = np.array([row["loss"] for row in rows], dtype=float)
            error = {
                name: scale / 100 * np.array([row["error_cm"][name] for row in rows], dtype=float)
                for name in ("value", "low", "high")
            }
            plot.fill_between(
                loss, error["low"], error["high"], color=color, alpha=0.15, linewidth=0
            )
            plot.plot(loss, error["value"], stroke, color=color, markersize=4, label=label)
        plot.set(
            xlabel="loss of the frame or its place",
            ylabel=f"Euclidean error ({unit})",
            ylim=(0, None),
        )
        legend_below(plot, 0.2)
    return figure


def similarity_by_distance(record: Record) -> Figure:
    """Similarity of pairs of frames by distance, median and quartiles, and the ideal."""
    series, sigma = record.series["similarity"], record.values["sigma"]["used_m"]
    distance = np.array(series["distance_m"])
    low, median, high = (np.array(series[key], dtype=float) for key in ("low", "median", "high"))
    with canvas(size=(6.4, 3.2)) as (figure, axes):
        plot = axes[0, 0]
        style: dict[str, Any] = {"color": SERIES[0]}
        plot.fill_between(
            distance, low, high, alpha=0.2, linewidth=0, label="half of all pairs", **style
        )
        plot.plot(distance, median, label="median", **style)
        curve = np.linspace(0, distance.max(), 200)
        ideal = np.exp(-(curve**2) / (2 * sigma**2))
        plot.plot(curve, ideal, color=SERIES[1], linestyle="--", label=f"ideal, σ = {sigma:g} m")
        plot.set(xlabel="distance (m)", ylabel="cosine similarity", xlim=(0, None), ylim=(0, 1.02))
        legend_below(plot, 0.2, columns=3)
    return figure


def sigma_sweep(record: Record) -> Figure:
    """The global loss, and three correlations, against sigma."""
    sweep, default = record.series["sweep"], record.values["sigma"]["used_m"]
    sigma = [row["sigma_m"] for row in sweep]
    lines = (
        ("agreement", "actual and ideal similarity", SERIES[2], "o"),
        ("prediction", "loss and k-NN error (ranks)", SERIES[0], "s"),
        ("same_order", f"loss at σ and at {default:g} m (ranks)", SERIES[1], "^"),
    )
    with canvas(2, 1, size=(6.4, 4.8), sharex=True, height_ratios=(1, 2)) as (figure, axes):
        loss, plot = axes[:, 0]
        losses = [row["global_loss"] for row in sweep]
        loss.plot(sigma, losses, color=COLORS["truth"], marker="o", markersize=4)
        loss.set(ylabel="global loss L")
        for key, label, color, marker in lines:
            values = [row[key] for row in sweep]
            if isinstance(values[0], dict):
                low, high = (
                    np.array([row[end] for row in values], dtype=float) for end in ("low", "high")
                )
                plot.fill_between(sigma, low, high, color=color, alpha=0.15, linewidth=0)
                values = [row["value"] for row in values]
            drawn = np.array(values, dtype=float)
            plot.plot(sigma, drawn, color=color, marker=marker, markersize=4, label=label)
        plot.set(xlabel="σ (m)", ylabel="correlation", xscale="log", ylim=(None, 1.05))
        plot.set_xticks(sigma, labels=[f"{value:.3g}" for value in sigma])
        plot.minorticks_off()
        for axis in (loss, plot):
            axis.axvline(default, color=COLORS["truth"], linestyle=":", linewidth=1.2)
            axis.axhline(0, color="#999999", linewidth=0.8)
        legend_below(plot, 0.2)
    return figure
