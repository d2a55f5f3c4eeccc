"""Speed against accuracy (paper, Analysis, "Speed versus Accuracy Trade-Off" and its figures;
Discussion).

`trexton.companion.experiments.sweeps` flies; here are the record, its headlines and its figures.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.executor import limited_threads
from trexton.companion.experiments.correlation import rank_correlation
from trexton.companion.experiments.declaration import POSITIONS, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import errors_of
from trexton.companion.experiments.metrics import block_rows, with_interval
from trexton.companion.experiments.style import (
    COLORS,
    SERIES,
    band,
    canvas,
    legend_below,
    plain_log_ticks,
)
from trexton.companion.experiments.sweeps import SWEPT, Bench, Sweep, choose_setting, time_stored
from trexton.companion.experiments.track import Track
from trexton.companion.wording import lengths, middle
from trexton.flights.flight import Flight


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    repeats: int = option(3, "independent runs of a setting; fewer where a frame is slow", low=1)
    stored: int = option(
        1_000_000, "the largest number of histograms that the search is timed on", low=1
    )


@limited_threads(1)  # whatever is timed; processes that are started inherit it
def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Vary one parameter at a time, the others at their defaults: the error, and the time of a
    frame.

    The time is that of `Localizer.step` on one thread, the image at hand and decoded. Only images
    can be sampled.
    """
    bench = Bench(train, test, parameters, parameters.repeats)
    sweeps = {name: bench.sweep(name) for name in SWEPT if name != "samples" or test.has_images}
    values, timings = _headlines(sweeps, bench)
    grid, tuned = choose_setting(bench)
    clocks = time_stored(bench, parameters.stored)
    values |= tuned | {
        "default": errors_of(bench.quoted, test, parameters.seed),
        "camera_hz": 1 / np.median(np.diff(test.time)),
        "applies": {"samples": test.has_images},
        "counts": {"train": len(train), "test": len(test)},
    }
    timings |= {name: sweep.clocks for name, sweep in sweeps.items()} | {
        "knn_tree_ms": clocks[-1]["tree"]["query_ms"],
        "knn_brute_force_ms": clocks[-1]["brute"]["query_ms"],
        "frequency_fewest_histograms_hz": clocks[0]["brute"]["frequency_hz"],
        "frequency_most_histograms_hz": clocks[-1]["brute"]["frequency_hz"],
        "stored": clocks,
    }
    series = {name: sweep.rows for name, sweep in sweeps.items()} | {"grid": grid}
    return parameters.record(train, test, values=values, series=series, timings=timings)


def _headlines(sweeps: dict[str, Sweep], bench: Bench) -> tuple[dict[str, Any], dict[str, Any]]:
    """The ends of both sweeps of the paper (errors in x, as it plots them), and what it
    concludes.
    """
    values, timings, errors, rates = {}, {}, [], []
    for name in ("samples", "particles"):
        if name not in sweeps:
            continue
        sweep, most = sweeps[name], "full_sampling" if name == "samples" else "most_particles"
        for label, end in ((f"fewest_{name}", 0), (most, -1)):
            values[f"{label}_error_cm"] = sweep.rows[end]["error_cm_x"]
            timings[f"{label}_ms"] = sweep.clocks[end]["frame_ms"]
        chosen = bench.defaults[name], sweep.rows[-1][name]
        default, last = (sweep.runs[value] for value in chosen)
        key = "plateau_gain" if name == "samples" else "particles_plateau_gain"
        values[key] = _gain(default, last, bench.test, rng=stream(bench.seed, "gain"))
        errors += [row["error_cm_x"]["value"] for row in sweep.rows]
        rates += [clock["frequency_hz"]["median"] for clock in sweep.clocks]
    rng = stream(bench.seed, "correlation")
    timings["error_frequency_correlation"] = rank_correlation(
        np.array(errors), np.array(rates), rng=rng, block=1
    )
    return values, timings


def _gain(
    before: list[Track], after: list[Track], test: Flight, *, rng: np.random.Generator
) -> dict[str, Any]:
    """By which share the error in x falls from one setting to another, with its 95 % interval."""
    first, second = (
        np.stack([np.abs(run.position - test.position)[:, 0] for run in runs])
        for runs in (before, after)
    )

    def share(a: np.ndarray, b: np.ndarray) -> float:
        return 1 - b.mean() / a.mean()

    drawn = []
    for _ in range(1000):
        rows = block_rows(len(test), rng)
        drawn.append(
            share(first[rng.integers(len(first)), rows], second[rng.integers(len(second)), rows])
        )
    value = share(np.median(first.mean(axis=1)), np.median(second.mean(axis=1)))
    return with_interval(value, drawn, len(test))


def finding(record: Record) -> str:
    """What the experiment found, in a few sentences."""
    values = record.values
    default = middle(values["default"]["axis_mean_cm"])
    say = lengths(default)
    text = f"With the paper's settings its filter has an error of {say(default)} an axis."
    if "tuned" in values:
        setting = values["tuned_setting"]
        words = f"{setting['particles']} particles, k = {setting['neighbors']}"
        if values["applies"]["samples"]:
            words += f", {setting['samples'] or 'all'} samples"
        text += (
            f" Of {len(record.series['grid'])} settings a replay of the training flight chooses "
            f"{words}, with {say(values['tuned_error_cm'])}."
        )
    if "fewest_samples_error_cm" in values:
        few, full = values["fewest_samples_error_cm"], values["full_sampling_error_cm"]
        text += (
            f" Every patch instead of {SWEPT['samples'][0]} brings the error in x from "
            f"{say(middle(few))} to {say(middle(full))}."
        )
    return text


_AXIS = {"samples": "samples an image", "particles": "particles"}


def error_and_rate(record: Record) -> Figure:
    """Error and rate against the particles and, of flights that have images, the samples."""
    names = [name for name in _AXIS if name in record.series]
    shape = {"sharex": "col", "sharey": "row", "height_ratios": (3, 2)}
    with canvas(2, len(names), size=(1.2 + 3 * len(names), 5.4), **shape) as (figure, axes):
        for (error, rate), name in zip(axes.T, names, strict=True):
            rows, clocks = record.series[name], record.timings[name]
            x = [row["patches"] if name == "samples" else row[name] for row in rows]
            for axis, stroke in (("x", "-"), ("y", ":")):
                spans = _spans(rows, f"error_cm_{axis}")
                line: dict[str, Any] = {"linestyle": stroke, "label": f"error in {axis}"}
                band(error, x, *spans, color=COLORS["paper"], marker="o", markersize=4.5, **line)
            spans = _spans(clocks, "frequency_hz")
            band(rate, x, *spans, color=COLORS["neighbors"], marker="o", markersize=4.5)
            error.set(ylim=(0, None), xscale="log")
            rate.set(yscale="log", xlabel=_AXIS[name])
            rate.axhline(record.values["camera_hz"], **_camera(record))
            plain_log_ticks(rate.yaxis)
            for each in (error, rate):
                default = record.parameters[name]
                each.axvline(default, color=COLORS["truth"], linestyle=":", linewidth=1)
            _ticks(rate, x, [row[name] for row in rows])
        axes[0, 0].set_ylabel("mean error (cm)")
        axes[1, 0].set_ylabel("rate (Hz)")
        for each in axes[:, -1]:
            each.legend()
    return figure


def stored(record: Record) -> Figure:
    """Rate of the loop against the number of stored histograms, searched in turn or by a tree."""
    clocks = record.timings["stored"]
    count = [row["stored"] for row in clocks]
    with canvas(size=(6.4, 4.0)) as (figure, [[plot]]):
        ways = ("brute", "every histogram in turn", SERIES[1]), ("tree", "k-d tree", SERIES[0])
        for method, label, color in ways:
            spans = _spans([row[method] for row in clocks], "frequency_hz")
            band(plot, count, *spans, color=color, marker="o", markersize=4.5, label=label)
        plot.set(xlabel="stored histograms", ylabel="rate (Hz)", xscale="log", yscale="log")
        plot.axvline(800, color=COLORS["printed"], linestyle=":", label="the paper's 800")
        plot.axhline(record.values["camera_hz"], **_camera(record))
        plain_log_ticks(plot.yaxis)
        _ticks(plot, count, count)
        legend_below(plot, 0.18, columns=2)
    return figure


def _camera(record: Record) -> dict[str, Any]:
    """Style of the line at the camera's rate: faster than this nothing is gained."""
    label = f"camera, {record.values['camera_hz']:.3g} Hz"
    return {"color": COLORS["truth"], "linewidth": 1.6, "linestyle": "-.", "label": label}


def _spans(rows: list[dict[str, Any]], key: str) -> np.ndarray:
    """``(3, N)``: low end, middle and high end of the intervals there."""
    entries = [row[key] for row in rows]
    middles = [entry["median" if "median" in entry else "value"] for entry in entries]
    low, high = ([entry[end] for entry in entries] for end in ("low", "high"))
    return np.array([low, middles, high], dtype=float)


def _name(value: int | None) -> str:
    return "all" if value is None else str(value) if value < 10_000 else f"{value // 1000:,} k"


def _ticks(axes: Axes, places: list[Any], values: list[Any]) -> None:
    """Ticks along x; every other one has its name where there are many, the last always."""
    step, last = 2 if len(values) > 8 else 1, len(values) - 1
    names = [_name(each) if i % step == 0 or i == last else "" for i, each in enumerate(values)]
    axes.set_xticks(places, labels=names)
    axes.minorticks_off()


EXPERIMENT = Experiment(
    "Speed against accuracy", Parameters, run, finding, needs=POSITIONS, cost_s=90, alone=True
)
