"""Figures of speed against accuracy: one parameter at a time, stored histograms, a grid."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.style import COLORS, SERIES, canvas, legend_below

__all__ = ["error_by_frequency", "grid", "neighbors", "particles", "samples", "stored", "training"]

_AXIS = {
    "samples": "samples an image",
    "particles": "particles",
    "neighbors": "neighbours k",
    "training": "histograms in the training set",
}


def samples(record: Record) -> Figure:
    """Error and rate against the samples drawn from an image; only of flights that have images."""
    return _error_and_rate(record, "samples")


def particles(record: Record) -> Figure:
    """Error and rate against the number of particles."""
    return _error_and_rate(record, "particles")


def training(record: Record) -> Figure:
    """Error and rate against the size of the training set."""
    return _error_and_rate(record, "training")


def neighbors(record: Record) -> Figure:
    """Error and rate against the number of neighbours."""
    return _error_and_rate(record, "neighbors")


def error_by_frequency(record: Record) -> Figure:
    """Error in x against the rate, along the samples and along the particles."""
    lines = (("samples", SERIES[0], "o"), ("particles", COLORS["particles"], "s"))
    with canvas(size=(6.4, 4.2)) as (figure, axes):
        plot = axes[0, 0]
        for name, color, marker in lines:
            rows, clocks = record.series.get(name, []), record.timings.get(name, [])
            if not rows:
                continue
            rate = _rates(clocks)
            error = _column(rows, "error_cm_x")
            bars: dict[str, Any] = {"xerr": _whiskers(rate), "yerr": _whiskers(error)}
            look: dict[str, Any] = {"color": color, "alpha": 0.9, "marker": marker, "markersize": 5}
            label = f"{_AXIS[name]}: {_ends(rows, name)}"
            plot.errorbar(
                rate["value"], error["value"], **bars, **look, elinewidth=0.8, label=label
            )
            for i, place, side in ((0, (6, 6), "left"), (-1, (-5, -12), "right")):
                at = (rate["value"][i], error["value"][i])
                style: dict[str, Any] = {
                    "textcoords": "offset points",
                    "color": color,
                    "fontsize": 9,
                }
                plot.annotate(_name(rows[i][name]), at, xytext=place, ha=side, **style)
        plot.set(xlabel="rate (Hz)", ylabel="error in x (cm)", xscale="log", ylim=(0, None))
        _camera(plot, record, vertical=True)
        plot.margins(x=0.08)
        _plain_ticks(plot, "x")
        legend_below(plot, 0.18)
    return figure


def stored(record: Record) -> Figure:
    """Rate of the loop against the number of stored histograms, searched in turn or by a tree."""
    clocks = record.timings["stored"]
    count = [row["stored"] for row in clocks]
    lines = (
        ("brute", "every histogram in turn", SERIES[1], "o"),
        ("tree", "tree of boxes", SERIES[0], "s"),
    )
    with canvas(size=(6.4, 4.0)) as (figure, axes):
        plot = axes[0, 0]
        for method, label, color, marker in lines:
            rate = _rates([row[method] for row in clocks])
            plot.fill_between(count, rate["low"], rate["high"], color=color, alpha=0.2, linewidth=0)
            plot.plot(count, rate["value"], color=color, marker=marker, markersize=5, label=label)
        plot.set(xlabel="stored histograms", ylabel="rate (Hz)", xscale="log", yscale="log")
        plot.axvline(800, color=COLORS["printed"], linestyle=":", label="the paper's 800")
        _camera(plot, record)
        _plain_ticks(plot, "x")
        _plain_ticks(plot, "y")
        legend_below(plot, 0.18, columns=3)
    return figure


def grid(record: Record) -> Figure:
    """Error of every setting of the grid; the tuned one and the best in hindsight marked."""
    rows, values = record.series["grid"], record.values
    groups = dict.fromkeys((row["samples"], row["particles"]) for row in rows)
    with canvas(size=(6.4, 3.8)) as (figure, axes):
        plot = axes[0, 0]
        for (drawn, count), color, marker in zip(groups, SERIES, "os^Dvp", strict=False):
            mine = [row for row in rows if (row["samples"], row["particles"]) == (drawn, count)]
            k, error = [row["neighbors"] for row in mine], _column(mine, "axis_mean_cm")
            of_all = "" if not record.values["applies"]["samples"] else f"{_name(drawn)} samples, "
            plot.fill_between(k, error["low"], error["high"], color=color, alpha=0.1, linewidth=0)
            label = f"{of_all}{_name(count)} particles"
            plot.plot(k, error["value"], color=color, marker=marker, markersize=5, label=label)
        for name, label, size in (("best", "best in hindsight", 15), ("tuned", "tuned", 20)):
            if name in values:
                at = (
                    values[f"{name}_setting"]["neighbors"],
                    values[f"{name}_error_cm"]["value"],
                )
                ring: dict[str, Any] = {
                    "markersize": size,
                    "markerfacecolor": "none",
                    "markeredgecolor": COLORS["truth" if name == "best" else "paper"],
                }
                plot.plot(*at, "o", label=label, **ring)
        plot.set(
            xlabel=_AXIS["neighbors"],
            ylabel="mean error, both axes (cm)",
            ylim=(0, None),
            xscale="log",
        )
        ticks = sorted({row["neighbors"] for row in rows})
        plot.set_xticks(ticks, labels=ticks)
        plot.minorticks_off()
        legend_below(plot, 0.18, columns=2)
    return figure


def _error_and_rate(record: Record, name: str) -> Figure:
    rows, clocks = record.series[name], record.timings[name]
    value = np.array(
        [row["patches"] if name == "samples" else row[name] for row in rows], dtype=float
    )
    full = name == "samples" and rows[-1]["samples"] is None
    swept = slice(None, -1 if full else None)
    with canvas(2, 1, size=(6.4, 5.4), sharex=True, height_ratios=(3, 2)) as (figure, axes):
        error, rate = axes[:, 0]
        knn = [row["knn"] for row in rows]
        lines = (
            ("filter, x", rows, "error_cm_x", COLORS["paper"], "-", "o"),
            ("filter, y", rows, "error_cm_y", COLORS["paper"], ":", "s"),
            ("k-NN alone, x", knn, "error_cm_x", COLORS["neighbors"], "-", None),
            ("k-NN alone, y", knn, "error_cm_y", COLORS["neighbors"], ":", None),
        )
        for label, table, key, color, style, marker in lines:
            _band(
                error, value, _column(table, key), swept, label=label, color=color,
                linestyle=style, marker=marker,
            )  # fmt: skip
        _band(rate, value, _rates(clocks), swept, color=COLORS["truth"], marker="o")
        error.set(ylabel="mean error (cm)", ylim=(0, None), xscale="log")
        rate.set(
            ylabel="rate (Hz)",
            yscale="log",
            xlabel=_AXIS[name] + (" (all: full sampling)" if full else ""),
        )
        _camera(rate, record)
        _plain_ticks(rate, "y")
        default = record.parameters.get(name)
        if default is not None:
            for axis in (error, rate):
                axis.axvline(default, color=COLORS["truth"], linestyle=":", linewidth=1)
        ticks = [*value[swept], *([value[-1]] if full else [])]
        rate.set_xticks(ticks, labels=_labels([row[name] for row in rows]))
        rate.minorticks_off()
        error.legend(loc="upper center", bbox_to_anchor=(0.5, 1.22), ncols=2)
    return figure


def _band(axes: Axes, x: np.ndarray, y: dict[str, Any], swept: slice, **style: Any) -> None:
    """A line with its interval; full sampling, which no line leads to, as a point with whiskers."""
    axes.fill_between(
        x[swept], y["low"][swept], y["high"][swept], color=style["color"], alpha=0.13, linewidth=0
    )
    axes.plot(x[swept], y["value"][swept], markersize=4.5, **style)
    if swept.stop is not None:
        last = {key: values[-1:] for key, values in y.items()}
        marker = style.get("marker") or "D"
        look: dict[str, Any] = {
            "color": style["color"],
            "marker": marker,
            "markersize": 6,
            "capsize": 2,
        }
        axes.errorbar(x[-1:], last["value"], yerr=_whiskers(last), **look)


def _camera(axes: Axes, record: Record, vertical: bool = False) -> None:
    """The camera's rate: faster than this nothing is gained."""
    hz, color = record.values["camera_hz"], COLORS["truth"]
    name = f"camera, {hz:.3g} Hz"
    style: dict[str, Any] = {"color": color, "fontsize": 9, "textcoords": "offset points"}
    if vertical:
        axes.axvline(hz, color=color, linewidth=1.6, linestyle="-.")
        axes.annotate(name, (hz, 1), xycoords=("data", "axes fraction"), xytext=(4, -10), **style)
    else:
        axes.axhline(hz, color=color, linewidth=1.6, linestyle="-.")
        axes.annotate(name, (0, hz), xycoords=("axes fraction", "data"), xytext=(6, 4), **style)
        axes.margins(y=0.12)


def _column(rows: list[dict[str, Any]], key: str, named: str = "value") -> dict[str, np.ndarray]:
    """``value``, ``low`` and ``high`` of the entries there, whose value is `named` so."""
    names = {"value": named, "low": "low", "high": "high"}
    return {
        name: np.array([row[key][place] for row in rows], dtype=float)
        for name, place in names.items()
    }


def _rates(clocks: list[dict[str, Any]]) -> dict[str, np.ndarray]:
    return _column(clocks, "frequency_hz", "median")


def _whiskers(column: dict[str, np.ndarray]) -> np.ndarray:
    """Lengths below and above, as `Axes.errorbar` takes them."""
    below, above = column["value"] - column["low"], column["high"] - column["value"]
    return np.asarray(np.maximum(0, np.stack([below, above])))


def _name(value: int | None) -> str:
    return "all" if value is None else f"{value:,}".replace(",", "\u202f")


def _labels(values: list[Any]) -> list[str]:
    """Names of the ticks; every other one where there are many, the last always."""
    step = 2 if len(values) > 8 else 1
    return [
        _name(value) if i % step == 0 or i == len(values) - 1 else ""
        for i, value in enumerate(values)
    ]


def _ends(rows: list[dict[str, Any]], name: str) -> str:
    return f"{_name(rows[0][name])} to {_name(rows[-1][name])}"


def _plain_ticks(axes: Axes, which: str) -> None:
    """1 000 instead of 10^3."""
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_formatter(lambda value, _: f"{value:g}" if value < 1000 else _name(round(value)))
