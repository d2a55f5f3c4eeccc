"""Speed against accuracy (paper, Analysis, "Speed versus Accuracy Trade-Off" and its figures;
Discussion).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from trexton.base.progress import progress
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.executor import limited_threads, working_on
from trexton.companion.experiments.correlation import rank_correlation
from trexton.companion.experiments.declaration import POSITIONS, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import frames_of, map_of
from trexton.companion.experiments.stored import time_stored
from trexton.companion.experiments.style import COLORS, SERIES, band, canvas, legend_below
from trexton.companion.experiments.track import Track, fly, tracks
from trexton.companion.experiments.tuned import search_settings
from trexton.companion.wording import interval, middle, number
from trexton.evaluation.metrics import absolute_errors, block_rows, bootstrap_interval, summarize
from trexton.evaluation.runtime import frequency, milliseconds
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.training import with_parts
from trexton.vision.histograms import texton_histogram
from trexton.vision.patches import position_grid

SWEPT: dict[str, tuple[Any, ...]] = {
    "samples": (25, 50, 100, 200, 400, 800, 1600, 3200, 6400, None),  # None: full sampling
    "particles": (5, 10, 25, 50, 100, 200, 400, 800),
    "neighbors": (1, 2, 3, 5, 7, 10, 15, 20),
    "training": (25, 50, 100, 200, 400, 800),
}
_KEPT = ("error_cm_x", "error_cm_y", "axis_mean_cm", "mean_cm")
_TIMED_FULL = 40  # frames are enough to time full sampling
_SLOW = {"samples": 1600, "particles": 400}  # beyond these a third of the runs will do


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    repeats: int = option(
        3, "independent runs for each setting; fewer where a frame takes long", low=1
    )
    stored: int = option(
        1_000_000, "the largest number of histograms that the search is timed on", low=1
    )


@limited_threads(1)  # whatever is timed; processes that are started inherit it
def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Vary one parameter at a time, the others at their defaults: the error, and the time of a
    frame.

    The time is that of `Localizer.step` on one thread, the image at hand and decoded. Only images
    can be sampled.

    Parameters
    ----------
    train, test : Flight
        With images, or with histograms.
    """
    texton_map = map_of(train, parameters)
    defaults = {
        "samples": parameters.samples,
        "particles": parameters.particles,
        "neighbors": parameters.neighbors,
        "training": len(train),
    }
    bench = _Bench(texton_map, train, test, defaults, parameters.repeats, parameters.seed)
    sweeps = {name: bench.sweep(name) for name in SWEPT if name != "samples" or test.has_images}
    values, timings = _headlines(sweeps, bench)
    grid, explored, best = search_settings(
        bench.wide,
        test,
        bench.frames,
        bench.full,
        samples=parameters.samples,
        repeats=parameters.repeats,
        seed=parameters.seed,
    )
    rows, clocks, agreement, ends = time_stored(
        bench.map,
        bench.frames,
        samples=parameters.samples,
        particles=parameters.particles,
        most=parameters.stored,
        seed=parameters.seed,
    )
    return parameters.record(
        train,
        test,
        values=values
        | best
        | {
            "default": bench.summary(
                [run.position for run in sweeps["particles"].runs[parameters.particles]]
            ),
            "tree_agrees": agreement,
            "camera_hz": 1 / np.median(np.diff(test.time)),
            "applies": {"samples": test.has_images},
            "counts": {"train": len(train), "test": len(test)},
        },
        series={name: sweep.rows for name, sweep in sweeps.items()}
        | {"stored": rows, "grid": grid, "explored": explored},
        timings=timings
        | ends
        | {name: sweep.clocks for name, sweep in sweeps.items()}
        | {"stored": clocks},
    )


def retrained(
    texton_map: TextonMap, *, rows: np.ndarray | None = None, neighbors: int | None = None
) -> TextonMap:
    """The map of some of its training frames only, or for another number of neighbours.

    The motion model stays: the vehicle moves no faster because fewer of its frames are kept.

    Parameters
    ----------
    rows : (M,) int array, optional
        Frames to keep.
    neighbors : int, optional
        k.
    """
    if rows is not None:
        texton_map = texton_map.select(rows)
    measurement = texton_map.parts["measurement"]
    if neighbors is not None:
        measurement = measurement.with_options(neighbors=neighbors)
    return with_parts(texton_map, {"measurement": measurement})


@dataclass
class _Sweep:
    """One parameter's rows, its times in the same order, and the runs behind them by value."""

    rows: list[dict[str, Any]] = field(default_factory=list)
    clocks: list[dict[str, Any]] = field(default_factory=list)
    runs: dict[int | None, list[Track]] = field(default_factory=dict)


class _Bench:
    """A map and a test flight, its images decoded once."""

    def __init__(
        self,
        texton_map: TextonMap,
        train: Flight,
        test: Flight,
        defaults: dict[str, Any],
        repeats: int,
        seed: int,
    ):
        self.map, self.train, self.test = texton_map, train, test
        self.defaults, self.repeats, self.seed = defaults, repeats, seed
        self.frames = frames_of(test)
        warm = Localizer(texton_map, rng=stream(seed, "warm-up"))
        warm.step(self.frames[0])  # the first call loads what later ones need

    @cached_property
    def full(self) -> list[np.ndarray]:
        """The test frames' histograms of full sampling."""
        if not self.test.has_images:
            return list(self.frames)
        images = progress(self.frames, "full sampling")
        return [texton_histogram(image, self.map.alphabet) for image in images]

    @cached_property
    def wide(self) -> TextonMap:
        """The map with a measurement model for as many neighbours as are swept."""
        limit = max(self.map.neighbors, len(self.train) // 4)
        most = max(k for k in (*SWEPT["neighbors"], self.map.neighbors) if k <= limit)
        return retrained(self.map, neighbors=most)

    def sweep(self, name: str) -> _Sweep:
        """Vary `name`, the others at their defaults."""
        limit = {"neighbors": self.wide.neighbors, "training": len(self.train)}.get(name, np.inf)
        values = {
            value
            for value in (*SWEPT[name], self.defaults[name])
            if value is None or value <= limit
        }
        result = _Sweep()
        for value in progress(sorted(values, key=lambda value: value or np.inf), f"varying {name}"):
            setting = self.defaults | {name: value}
            # The paper's two figures get all runs.
            repeats = (
                self.repeats if name in ("samples", "particles") else max(3, self.repeats // 2)
            )
            runs = result.runs[value] = self._runs(setting, repeats)
            filtered, knn = (
                self.summary([getattr(run, of) for run in runs]) for of in ("position", "knn")
            )
            errors = {key: filtered[key] for key in _KEPT} | {
                "knn": {key: knn[key] for key in _KEPT}
            }
            step_s = (
                self._full_times() if setting["samples"] is None else [run.step_s for run in runs]
            )
            time_ms = milliseconds(step_s)
            result.rows.append(setting | self._patches(setting) | {"runs": len(runs)} | errors)
            result.clocks.append(
                setting | {"frame_ms": time_ms, "frequency_hz": frequency(time_ms)}
            )
        return result

    def summary(self, estimates: list[np.ndarray]) -> dict[str, Any]:
        """Statistics of several runs over the test flight."""
        rng = stream(self.seed, "intervals")
        return summarize(estimates, self.test.position, self.test.diagonal, rng=rng, draws=300)

    def _runs(self, setting: dict[str, Any], repeats: int) -> list[Track]:
        texton_map, frames = self.wide, self.frames
        if any((setting[key] or 0) > most for key, most in _SLOW.items()):
            repeats = max(3, repeats // 3)
        if setting["training"] != len(self.train):
            rows = np.linspace(0, len(self.train) - 1, setting["training"]).round().astype(int)
            texton_map = retrained(self.map, rows=rows)
        if setting["samples"] is None:
            frames = self.full
        options = {key: setting[key] for key in ("samples", "particles", "neighbors")}
        with working_on():  # timed: nothing runs beside
            return tracks(texton_map, frames, repeats=repeats, seed=self.seed, **options)

    def _full_times(self) -> list[np.ndarray]:
        options = {key: self.defaults[key] for key in ("particles", "neighbors")}
        localizer = Localizer(self.wide, samples=None, rng=stream(self.seed, "warm-up"), **options)
        return [fly(localizer, self.frames[:_TIMED_FULL]).step_s]

    def _patches(self, setting: dict[str, Any]) -> dict[str, Any]:
        """How many patches of an image are looked at; none where the flight came as histograms."""
        if not self.test.has_images:
            return {"patches": None}
        every = math.prod(position_grid(self.frames[0].shape, self.map.alphabet.patch))
        return {"patches": setting["samples"] or every}


def _headlines(sweeps: dict[str, _Sweep], bench: _Bench) -> tuple[dict[str, Any], dict[str, Any]]:
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
        default, last = (
            sweep.runs[value] for value in (bench.defaults[name], sweep.rows[-1][name])
        )
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
    before: list[Track],
    after: list[Track],
    test: Flight,
    *,
    rng: np.random.Generator,
    draws: int = 1000,
) -> dict[str, Any]:
    """By which share the error in x falls from one setting to another, with its 95 % interval."""
    first, second = (
        np.stack([absolute_errors(run.position, test.position)[:, 0] for run in runs])
        for runs in (before, after)
    )

    def share(a: np.ndarray, b: np.ndarray) -> float:
        return 1 - b.mean() / a.mean()

    drawn = []
    for _ in range(draws):
        rows = block_rows(len(test), rng)
        drawn.append(
            share(first[rng.integers(len(first)), rows], second[rng.integers(len(second)), rows])
        )
    low, high = bootstrap_interval(drawn, len(test))
    value = share(np.median(first.mean(axis=1)), np.median(second.mean(axis=1)))
    return {"value": value, "low": low, "high": high}


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    values = record.values
    chosen = "tuned" if "tuned" in values else "best"
    setting = values[f"{chosen}_setting"]
    words = f"{setting['particles']} particles"
    words += f", {setting['neighbors']} neighbours" if setting["neighbors"] > 1 else ", 1 neighbour"
    if values["applies"]["samples"]:
        words += f", {setting['samples']} samples" if setting["samples"] else ", every patch"
    how = "chosen by replaying the training flight" if chosen == "tuned" else "best in hindsight"
    text = (
        f"Of {len(record.series['grid'])} settings of the paper's filter the one {how} "
        f"({words}) has an error of {interval(values[f'{chosen}_error_cm'], 'cm')} an axis "
        "instead of "
        f"{number(middle(values['default']['axis_mean_cm']))} cm with the paper's"
    )
    if chosen == "tuned":
        text += f" (best in hindsight: {number(middle(values['best_error_cm']))} cm)"
    if "fewest_samples_error_cm" in values:
        few, full = values["fewest_samples_error_cm"], values["full_sampling_error_cm"]
        text += (
            f"; every patch instead of {SWEPT['samples'][0]} brings the error in x from "
            f"{number(middle(few))} to {number(middle(full))} cm"
        )
    return text + "."


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
            plot.errorbar(
                rate["value"], error["value"], xerr=_whiskers(rate), yerr=_whiskers(error),
                color=color, alpha=0.9, marker=marker, markersize=5, elinewidth=0.8,
                label=f"{_AXIS[name]}: {_ends(rows, name)}",
            )  # fmt: skip
            for i, place, side in ((0, (6, 6), "left"), (-1, (-5, -12), "right")):
                at = (rate["value"][i], error["value"][i])
                plot.annotate(
                    _name(rows[i][name]), at, xytext=place, ha=side, textcoords="offset points",
                    color=color, fontsize=9,
                )  # fmt: skip
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
            _band(plot, count, rate, color=color, marker=marker, label=label)
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
            label = f"{of_all}{_name(count)} particles"
            _band(plot, k, error, color=color, marker=marker, label=label)
        for name, label, size in (("best", "best in hindsight", 15), ("tuned", "tuned", 20)):
            if name in values:
                k, error = (
                    values[f"{name}_setting"]["neighbors"],
                    values[f"{name}_error_cm"]["value"],
                )
                edge = COLORS["truth" if name == "best" else "paper"]
                plot.plot(
                    k, error, "o", label=label, markersize=size, markerfacecolor="none",
                    markeredgecolor=edge,
                )  # fmt: skip
        plot.set(xlabel=_AXIS["neighbors"], ylabel="mean error, both axes (cm)")
        plot.set(ylim=(0, None), xscale="log")
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
            _swept(
                error, value, _column(table, key), full, label=label, color=color,
                linestyle=style, marker=marker,
            )  # fmt: skip
        _swept(rate, value, _rates(clocks), full, color=COLORS["truth"], marker="o")
        error.set(ylabel="mean error (cm)", ylim=(0, None), xscale="log")
        rate.set(ylabel="rate (Hz)", yscale="log")
        rate.set_xlabel(_AXIS[name] + (" (all: full sampling)" if full else ""))
        _camera(rate, record)
        _plain_ticks(rate, "y")
        default = record.parameters.get(name)
        if default is not None:
            for axis in (error, rate):
                axis.axvline(default, color=COLORS["truth"], linestyle=":", linewidth=1)
        rate.set_xticks(value, labels=_labels([row[name] for row in rows]))
        rate.minorticks_off()
        error.legend(loc="upper center", bbox_to_anchor=(0.5, 1.22), ncols=2)
    return figure


def _band(axes: Axes, x: Any, y: dict[str, np.ndarray], **line: Any) -> None:
    """A line with its interval, of a `_column`."""
    band(axes, x, y["low"], y["value"], y["high"], markersize=4.5, **line)


def _swept(axes: Axes, x: np.ndarray, y: dict[str, np.ndarray], full: bool, **line: Any) -> None:
    """A `_band`; where the last is `full` sampling, no line leads to it: a point with whiskers."""
    if not full:
        return _band(axes, x, y, **line)
    _band(axes, x[:-1], {key: values[:-1] for key, values in y.items()}, **line)
    last = {key: values[-1:] for key, values in y.items()}
    axes.errorbar(
        x[-1:], last["value"], yerr=_whiskers(last), color=line["color"],
        marker=line["marker"] or "D", markersize=6, capsize=2,
    )  # fmt: skip


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


EXPERIMENT = Experiment(
    "Speed against accuracy", Parameters, run, finding, needs=POSITIONS, cost_s=90, alone=True
)
