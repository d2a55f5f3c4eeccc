"""Training on motion-capture positions (paper, "Training Set based on Motion Tracking System")."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

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

__all__ = ["EXPERIMENT", "finding", "Parameters", "run"]


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
        f"The paper's filter errs by {interval(values['filter']['mean_cm'], 'cm')}, "
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


EXPERIMENT = Experiment(
    "Training on motion-capture positions", Parameters, run, finding, needs=POSITIONS, cost_s=40
)
