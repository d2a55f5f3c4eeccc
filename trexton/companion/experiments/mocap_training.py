"""Training on motion-capture positions (paper, "Training Set based on Motion Tracking System")."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import POSITIONS, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import (
    drift,
    evaluate,
    floor_picture,
    frames_of,
    map_of,
    whereabouts,
)
from trexton.companion.experiments.style import (
    COLORS,
    canvas,
    legend_above,
    legend_below,
    length_unit,
    mean_line,
    plan_canvas,
)
from trexton.companion.experiments.track import Track, tracks
from trexton.companion.wording import beside, interval, middle, number, percent
from trexton.evaluation.metrics import (
    absolute_errors,
    block_rows,
    bootstrap_interval,
    euclidean,
    summarize,
)
from trexton.evaluation.runtime import of_frames
from trexton.flights.flight import Flight
from trexton.localization.localizer import TextonMap
from trexton.localization.roles import ROLES

LANDING_SPREAD_M = 0.6  # the paper's threshold: no landing where the particles spread wider
MOST_LAG_FRAMES = 60


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    repeats: int = option(20, "independent runs of the filter over the test flight", low=1)
    resampling: str = option("wheel", "how particles are resampled")
    estimator: str = option("map", "point estimate of the particles")


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Train on one flight, localize every frame of another, compare with motion capture.

    Parameters
    ----------
    train, test : Flight
        With images, or with histograms; then `samples` and `textons` do not apply.
    """
    texton_map = map_of(train, parameters)
    options: dict[str, Any] = {
        "samples": parameters.samples,
        "particles": parameters.particles,
        "resampling": parameters.resampling,
        "estimation": parameters.estimator,
    }
    frames = frames_of(test)
    runs = tracks(texton_map, frames, repeats=parameters.repeats, seed=parameters.seed, **options)
    values, series = evaluate(
        runs, texton_map.positions, test, k=parameters.neighbors, seed=parameters.seed
    )
    series |= whereabouts(train)
    floor, pictures = floor_picture(test)
    rank_std_cm = 100 * texton_map.parts["measurement"].deviations
    process = texton_map.parts["motion"].growth(texton_map.period_s)
    values |= {
        "drift_cm_per_min": drift(runs, test, rng=stream(parameters.seed, "drift")),
        "estimators": _estimators(texton_map, frames, test, runs, parameters.seed, options),
        "counts": {
            "train": len(texton_map.positions),
            "test": len(test),
            "test_s": test.time[-1] - test.time[0],
            "textons": texton_map.histograms.shape[1],
            "lost": np.mean([run.lost.sum() for run in runs]),
        },
        "spread": _spread(runs, test, stream(parameters.seed, "spread")),
        "lag": _lag(runs, test),
        "applies": {"sampling": test.has_images, "dictionary": train.has_images},
        "model": {
            "process_std_cm": 100 * np.sqrt(np.diagonal(process)),
            "rank_std_cm": rank_std_cm,
            "first_rank_std_cm": rank_std_cm[0].mean(),
            "last_rank_std_cm": rank_std_cm[-1].mean(),
        },
    }
    if train.name == test.name:
        values["exchanged"] = _exchanged(train, test, parameters, options)
    step_s = np.concatenate([run.step_s for run in runs])
    return parameters.record(
        train,
        test,
        values=values,
        series=series | floor,
        images=pictures,
        timings={"step_s": of_frames(step_s)},
    )


def _exchanged(
    train: Flight, test: Flight, parameters: Parameters, options: dict[str, Any]
) -> dict[str, Any]:
    """Where both are parts of one flight: trained on the later, tested on the earlier part."""
    texton_map = map_of(test, parameters)
    runs = tracks(
        texton_map, frames_of(train), repeats=parameters.repeats, seed=parameters.seed, **options
    )
    values, _ = evaluate(
        runs, texton_map.positions, train, k=parameters.neighbors, seed=parameters.seed
    )
    return {name: values[name] for name in ("filter", "knn")}


def _estimators(
    texton_map: TextonMap,
    frames: Sequence[np.ndarray],
    test: Flight,
    runs: list[Track],
    seed: int,
    options: dict[str, Any],
) -> dict[str, Any]:
    """Mean Euclidean error in cm under each point estimate; particles are the same under all."""
    result = {}
    for name in ROLES["estimation"]:
        same = name == options["estimation"]
        others = (
            runs
            if same
            else tracks(
                texton_map, frames, repeats=len(runs), seed=seed, **options | {"estimation": name}
            )
        )
        rng = stream(seed, "estimators")
        result[name] = summarize(
            [run.position for run in others], test.position, test.diagonal, rng=rng
        )["mean_cm"]
    return result


def _spread(
    runs: list[Track], test: Flight, rng: np.random.Generator, draws: int = 500
) -> dict[str, Any]:
    """Is the particles' spread honest? Shares of the errors of an axis that it covers."""
    ratio = np.array(
        [
            absolute_errors(run.position, test.position) / np.maximum(run.spread, 1e-9)
            for run in runs
        ]
    )
    drawn = [
        (ratio[rng.integers(len(runs)), block_rows(len(test), rng)] <= 2).mean()
        for _ in range(draws)
    ]
    low, high = bootstrap_interval(drawn, len(test))
    widest = np.array([run.spread.max(axis=1) for run in runs])
    return {
        "within_one": (ratio <= 1).mean(),
        "within_two": {"value": (ratio <= 2).mean(), "low": low, "high": high},
        "mean_cm": 100 * np.mean([run.spread for run in runs]),
        "landing_threshold_cm": 100 * LANDING_SPREAD_M,
        "frames_wider_than_landing": np.mean((widest >= LANDING_SPREAD_M).sum(axis=1)),
    }


def _lag(runs: list[Track], test: Flight) -> dict[str, Any]:
    """By how much the estimates trail: the shift in time under which they fit the truth best."""
    shifts = range(min(MOST_LAG_FRAMES, len(test) // 4))
    errors = [
        np.mean([euclidean(run.position[n:], test.position[: len(test) - n]) for run in runs])
        for n in shifts
    ]
    best = int(np.argmin(errors))
    period = (test.time[-1] - test.time[0]) / max(1, len(test) - 1)
    return {"frames": best, "s": best * period, "error_cm": 100 * errors[best]}


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    values, lag, spread = record.values, record.values["lag"], record.values["spread"]
    error, knn = (middle(values[name]["mean_cm"]) for name in ("filter", "knn"))
    parts = [
        f"The paper's filter has an error of {interval(values['filter']['mean_cm'], 'cm')}, "
        f"{beside(error / knn)} the plain mean of its own neighbours "
        f"({interval(values['knn']['mean_cm'], 'cm')})"
    ]
    if lag["error_cm"] < 0.8 * error:
        parts.append(
            f"it trails the vehicle (shifted back by {number(lag['s'])} s, its estimates would err "
            f"by {number(lag['error_cm'])} cm)"
        )
    held = percent(spread["within_two"])
    honest = "as it should" if middle(spread["within_two"]) >= 0.9 else "where 95 % should lie"
    parts.append(f"twice its spread covers {held} of the errors of an axis, {honest}")
    return f"{parts[0]}: {', and '.join(parts[1:])}."


_ROWS = (("knn", "k-NN alone", "neighbors"), ("estimate", "particle filter", "paper"))


def floor_plan(record: Record) -> Figure:
    """Truth and estimate over the floor."""
    series = record.series
    truth, estimate = np.array(series["truth_m"]), np.array(series["estimate_m"])
    color, label = COLORS["paper"], "estimate (every 5th frame)"
    with plan_canvas(record, (5.4, 5.0)) as (figure, plan):
        # Every fifth frame: where the estimate was against the truth.
        for pair in zip(truth[::5], estimate[::5], strict=True):
            plan.plot(*np.transpose(pair), color=color, linewidth=0.5, alpha=0.6)
        plan.plot(*truth.T, color=COLORS["truth"], linewidth=2, label="motion capture")
        plan.plot(*estimate[::5].T, "o", color=color, markersize=3, label=label)
        legend_below(plan, 0.12, columns=2)
    return figure


def error_over_time(record: Record) -> Figure:
    """Absolute error in x and y over the flight, of filter and k-NN alone, with their means."""
    series = record.series
    time, truth = np.array(series["time_s"]), np.array(series["truth_m"])
    errors = {key: np.abs(np.array(series[f"{key}_m"]) - truth) for key, _, _ in _ROWS}
    unit, scale = length_unit(min(error.mean() for error in errors.values()))
    with canvas(2, 1, size=(7.2, 4.2), sharex=True, sharey=True) as (figure, axes):
        for axis, name in enumerate("xy"):
            plot = axes[axis, 0]
            for key, label, color in _ROWS:
                error = scale * errors[key][:, axis]
                plot.plot(time, error, color=COLORS[color], label=label, linewidth=1.0)
                mean_line(plot, error, COLORS[color], unit)
            plot.set_ylabel(f"error in {name} ({unit})")
        axes[0, 0].set_ylim(0, None)
        legend_above(axes[0, 0])
        axes[1, 0].set_xlabel("time (s)")
    return figure


def spread_over_time(record: Record) -> Figure:
    """Standard deviation of the particles in x and y over the flight."""
    series = record.series
    time, spread = np.array(series["time_s"]), np.array(series["spread_m"])
    unit, scale = length_unit(float(spread.mean()))
    with canvas(size=(7.2, 2.4)) as (figure, axes):
        for axis, (name, style) in enumerate((("x", "-"), ("y", ":"))):
            axes[0, 0].plot(
                time, scale * spread[:, axis], color=COLORS["particles"], linestyle=style,
                linewidth=1.2, label=f"spread in {name}",
            )  # fmt: skip
        axes[0, 0].set(xlabel="time (s)", ylabel=f"particle spread ({unit})", ylim=(0, None))
        legend_above(axes[0, 0])
    return figure


EXPERIMENT = Experiment(
    "Training on motion-capture positions", Parameters, run, finding, needs=POSITIONS, cost_s=40
)
