"""Figures of a frame's time: stages beside the paper's, and every frame of the flight."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.companion.experiments.printed import published
from trexton.companion.experiments.style import COLORS, canvas, legend_below

__all__ = ["frames", "stages"]

# record's key: (label, key of the paper's value or None)
_ROWS = {
    "histogram": ("histogram", "histogram_ms"),
    "neighbors": ("k nearest neighbours", None),
    "filter": ("particle filter", None),
    "estimate": ("estimate and spread", None),
    "rest": ("neighbours, filter, estimate", "rest_ms"),
    "total": ("whole frame", "total_ms"),
    "full": ("whole frame, full sampling", "full_sampling_ms"),
    "homography": ("homography", "homography_ms"),
}


def times(record: Record) -> dict[str, dict[str, Any]]:
    """Median and 99th percentile in ms of every row of the figure that this flight has."""
    timings = record.timings
    found = dict(timings["stages_ms"])
    parts = [timings["frames_ms"][name] for name in ("neighbors", "filter", "estimate")]
    rest = np.sum(parts, axis=0)
    found["rest"] = {"median": float(np.median(rest)), "p99": float(np.percentile(rest, 99))}
    found["total"] = timings["total_ms"]
    optional = {"full": "full_sampling_ms", "homography": "homography_ms"}
    found |= {row: timings[key] for row, key in optional.items() if key in timings}
    return {name: found[name] for name in _ROWS if name in found}


def stages(record: Record) -> Figure:
    """Each stage on a logarithmic axis: median to 99th percentile, the paper's value beside it."""
    ours, paper = times(record), dict(published()["timing"])
    paper["full_sampling_ms"] = 1000 / paper["full_sampling_hz"]
    with canvas(size=(7.2, 0.8 + 0.42 * len(ours))) as (figure, axes):
        plot = axes[0, 0]
        for place, (name, time) in enumerate(reversed(ours.items())):
            at = (time["median"], place)
            plot.hlines(
                place, time["median"], time["p99"], color=COLORS["paper"], linewidth=4, alpha=0.3
            )
            label = "here, to the 99th percentile" if not place else None
            plot.plot(*at, "o", color=COLORS["paper"], label=label)
            style: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "fontsize": 8}
            plot.annotate(f"{time['median']:.3g} ms", at, xytext=(0, 6), **style)
            if (key := _ROWS[name][1]) is not None:
                label = "the paper" if key == "total_ms" else None
                plot.plot(paper[key], place, "D", color=COLORS["printed"], label=label)
        camera = paper["camera_hz"]
        plot.axvline(
            1000 / camera, color=COLORS["truth"], linestyle=":", label=f"one frame at {camera:g} Hz"
        )
        plot.set_yticks(range(len(ours)), labels=[_ROWS[name][0] for name in reversed(ours)])
        plot.set(xscale="log", xlabel="time a frame (ms)", ylim=(-0.6, len(ours) - 0.2))
        plot.margins(x=0.07)
        plot.xaxis.set_major_formatter("{x:g}")
        plot.grid(False, axis="y")
        plot.legend(
            loc="upper center", bbox_to_anchor=(0.4, -0.8 / (0.8 + 0.42 * len(ours))), ncols=3
        )
    return figure


def frames(record: Record) -> Figure:
    """The time of every frame of the flight, split by stage."""
    split = {name: np.array(values) for name, values in record.timings["frames_ms"].items()}
    del split["total"]
    total = record.timings["total_ms"]
    colors = {
        "histogram": COLORS["zone"], "neighbors": COLORS["neighbors"],
        "filter": COLORS["particles"], "estimate": COLORS["paper"],
    }  # fmt: skip
    with canvas(size=(7.2, 3.0)) as (figure, axes):
        plot = axes[0, 0]
        count = len(next(iter(split.values())))
        plot.stackplot(
            np.arange(count), *split.values(), labels=[_ROWS[name][0] for name in split],
            colors=[colors[name] for name in split], step="mid", linewidth=0,
        )  # fmt: skip
        whole = np.sum(list(split.values()), axis=0)
        plot.step(
            np.arange(count), whole, where="mid", color=COLORS["truth"], linewidth=0.5,
            label="whole frame",
        )  # fmt: skip
        for key, style in (("median", "-"), ("p99", "--")):
            label = {"median": "median", "p99": "99th percentile"}[key]
            plot.axhline(
                total[key], color=COLORS["truth"], linestyle=style, linewidth=1, label=label
            )
        plot.set(
            xlabel="frame", ylabel="time (ms)", xlim=(0, count - 1), ylim=(0, 1.6 * total["p99"])
        )
        legend_below(plot, 0.22, columns=3)
    return figure
