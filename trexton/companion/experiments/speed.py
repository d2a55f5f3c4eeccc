"""How near each stage comes to the machine's limit: the rows of `trexton bench`, and the roofline.

Bandwidth and peak arithmetic of one thread are measured beside the bench.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.ticker import NullFormatter

from trexton.base.records import Record, machine
from trexton.base.streams import stream
from trexton.companion.checks.bench import STAGES, measure
from trexton.companion.checks.timing import Row, interleave
from trexton.companion.executor import limited_threads
from trexton.companion.experiments.declaration import IMAGES, Experiment, SeedParameters, option
from trexton.companion.experiments.style import COLORS, SERIES, canvas, legend_below
from trexton.companion.wording import duration, number
from trexton.flights.flight import Flight

_COPIED = 64 * 2**20  # bytes: beyond every cache
# stage and size of a row: (operations, bytes that must be read or written at least)
_WORK = {
    ("full histogram", "640x480"): (1.303e9, 640 * 480 * 3),
    ("sampled histogram", "400"): (400 * 20 * 108 * 2, 400 * 108),
    ("neighbours", "800"): (800 * 20 * 2, 800 * 20 * 8),
    ("filter step", "50"): (50**2 * 8, 50 * 2 * 3 * 8),  # with more, not all pairs are looked at
}


@dataclass(frozen=True)
class Parameters(SeedParameters):
    """What can be chosen."""

    quick: bool = option(True, "fewer and smaller measurements, as in trexton bench --quick")


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Run the bench, and measure the two roofs: copying memory and multiplying matrices, both on
    one thread.

    Parameters
    ----------
    train, test : Flight
        Name the record; the bench makes its own frames, which are the same for every flight.
    """
    start = time.perf_counter()
    rows = list(measure(quick=parameters.quick, seed=parameters.seed))
    with limited_threads(1):
        roofs = _roofs(stream(parameters.seed, "roofs"))
    return parameters.record(
        train,
        test,
        values={"stages": list(STAGES), "limits": sum(row.limit is not None for row in rows)},
        timings={
            "machine": machine(),
            "rows": [row.as_dict() for row in rows],
            "held": sum(row.holds is True for row in rows),
            "points": _points(rows),
            "bench_s": time.perf_counter() - start,
            **roofs,
        },
    )


def _roofs(rng: np.random.Generator) -> dict[str, Any]:
    source = np.zeros(_COPIED, np.uint8)
    target, square = np.empty_like(source), rng.random((1024, 1024), dtype=np.float32)
    times = interleave(
        {"copy": lambda: np.copyto(target, source), "sgemm": lambda: square @ square}, 0.3
    )
    return {
        "bytes_per_s": 2 * _COPIED / times["copy"].median,
        "operations_per_s": 2.0 * 1024**3 / times["sgemm"].median,
    }


def _points(rows: list[Row]) -> list[dict[str, Any]]:
    """Work and rate of the stages whose work can be counted, on one thread where that was timed."""
    points = {}
    for row in rows:
        if (key := (row.stage, row.size)) in _WORK and key not in points:
            operations, touched = _WORK[key]
            points[key] = {
                "stage": row.stage, "size": row.size, "operations_per_byte": operations / touched,
                "operations_per_s": operations / row.ours_s,
            }  # fmt: skip
    return list(points.values())


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    limits, held = record.values["limits"], record.timings["held"]
    missed = [row for row in record.timings["rows"] if row["holds"] is False]
    text = f"{held} of {limits} stages reach what they must against their yardstick"
    if missed:
        worst = max(missed, key=lambda row: row["ratio"] / row["limit"])
        text += (
            f"; furthest off is {worst['stage']} ({worst['size']}) with {number(worst['ratio'])} "
            f"times its yardstick ({worst['yardstick']}), where {number(worst['limit'])} is asked"
        )
    return text + "."


def limits(record: Record) -> Figure:
    """Ratio of each stage to what it must reach; left of the line is quicker than asked for."""
    asked = [row for row in record.timings["rows"] if row["limit"] is not None]
    share = [row["ratio"] / row["limit"] for row in asked]
    colors = [SERIES[0] if row["holds"] else SERIES[1] for row in asked]
    with canvas(size=(7.2, 0.9 + 0.24 * len(asked))) as (figure, axes):
        plot = axes[0, 0]
        places = np.arange(len(asked))[::-1]
        plot.hlines(places, share, 1, color=colors, linewidth=3, alpha=0.5)
        plot.scatter(share, places, color=colors, s=22, zorder=3)
        plot.axvline(1, color=COLORS["truth"], linewidth=1)
        plot.set_yticks(places, labels=[_label(row) for row in asked], fontsize=8)
        plot.set(
            xscale="log",
            xlabel="time, as a share of what is allowed",
            ylim=(-0.7, len(asked) - 0.3),
        )
        plot.xaxis.set_major_formatter("{x:g}")
        plot.xaxis.set_minor_formatter(NullFormatter())
        plot.grid(False, axis="y")
    return figure


def _label(row: dict[str, Any]) -> str:
    threads = f", {row['threads']} threads" if row["threads"] > 1 else ""
    return f"{row['stage']}, {row['size']}{threads} / {row['yardstick']}"


def roofline(record: Record) -> Figure:
    """Operations a second against operations a byte, under the machine's memory and arithmetic."""
    timings = record.timings
    memory, peak = timings["bytes_per_s"], timings["operations_per_s"]
    points = timings["points"]
    intensity = np.array([point["operations_per_byte"] for point in points])
    with canvas(size=(7.2, 4.2)) as (figure, axes):
        plot = axes[0, 0]
        span = np.geomspace(min(intensity.min(), 0.3 * peak / memory) / 2, intensity.max() * 3, 200)
        roof = np.minimum(memory * span, peak)
        label = "one thread: memory copied, matrices multiplied (sgemm)"
        plot.plot(span, roof / 1e9, color=COLORS["truth"], label=label)
        plot.fill_between(span, roof / 1e9, color=COLORS["truth"], alpha=0.07, linewidth=0)
        for point, color, marker in zip(points, SERIES, "os^Dvp", strict=False):
            at = point["operations_per_byte"], point["operations_per_s"] / 1e9
            label = f"{point['stage']}, {point['size']}"
            plot.plot(*at, marker, color=color, markersize=8, linestyle="none", label=label)
        plot.set(xlabel="operations a byte", ylabel="thousand million operations a second")
        plot.set(xscale="log", yscale="log")
        _plain_numbers(plot)
        legend_below(plot, 0.16, columns=2)
    return figure


def growth(record: Record) -> Figure:
    """Time against each size on logarithmic axes, with the fitted exponent."""
    families: dict[str, list[dict[str, Any]]] = {}
    for row in record.timings["rows"]:
        if row["stage"].startswith("growth, "):
            families.setdefault(row["stage"].removeprefix("growth, "), []).append(row)
    columns = 3
    lines = -(-len(families) // columns)
    with canvas(lines, columns, size=(7.6, 2.6 * lines)) as (figure, axes):
        # Labels apart from the titles below.
        cast(ConstrainedLayoutEngine, figure.get_layout_engine()).set(h_pad=0.14)
        for axis in axes.flat[len(families) :]:
            axis.set_axis_off()
        for axis, (name, rows) in zip(axes.flat, families.items(), strict=False):
            size, fitted = (
                [float(row["size"]) for row in rows],
                [1000 * row["yardstick_s"] for row in rows],
            )
            ours = [1000 * row["ours_s"] for row in rows]
            axis.plot(size, ours, "o", color=SERIES[0], markersize=5, clip_on=False)
            axis.plot(size, fitted, color=SERIES[1], linewidth=1)
            axis.set(xscale="log", yscale="log", xlabel=name, ylabel="ms")
            axis.set(xlim=_whole_decades(size), ylim=_whole_decades(ours + fitted))
            axis.set_title(rows[0]["yardstick"].removeprefix("fit, "), fontsize=9.5)
            axis.xaxis.label.set_fontsize(8.5)
            _plain_numbers(axis)
    return figure


def _plain_numbers(axes: Axes) -> None:
    """Numbers at powers of ten only, written out."""
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_formatter(
            lambda value, _: f"{value:,.10g}" if value < 1e6 else f"{value / 1e6:g} M"
        )
        axis.set_minor_formatter(NullFormatter())


def _whole_decades(values: list[float]) -> tuple[float, float]:
    low, high = np.floor(np.log10(min(values))), np.ceil(np.log10(max(values)))
    return 10.0**low, 10.0 ** max(high, low + 1)


def rows(record: Record) -> pd.DataFrame:
    """All rows of the bench as a table for people."""
    return pd.DataFrame(
        {
            "Stage": row["stage"],
            "Size": row["size"],
            "Threads": row["threads"],
            "Ours": duration(row["ours_s"]),
            "Yardstick": row["yardstick"],
            "takes": duration(row["yardstick_s"]),
            "Ratio": f"{row['ratio']:.3g}",
            "at most": "" if row["limit"] is None else f"{row['limit']:.2f}",
            "": {True: "holds", False: "missed", None: ""}[row["holds"]],
        }
        for row in record.timings["rows"]
        if not row["stage"].startswith("growth")
    )


EXPERIMENT = Experiment(
    "As fast as the machine allows", Parameters, run, finding, needs=IMAGES, cost_s=65, alone=True
)
