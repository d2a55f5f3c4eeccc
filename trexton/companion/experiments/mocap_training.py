"""Training on measured positions (paper, "Training Set based on Motion Tracking System"). The
error of the filter and of its neighbours.
"""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import POSITIONS, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import (
    RUNS,
    constant_guess,
    drift,
    errors_of,
    floor_picture,
    flown,
    frames_of,
    lag,
    map_of,
    shuffled_neighbors,
    whereabouts,
)
from trexton.companion.experiments.metrics import mean_with_interval, summarize
from trexton.companion.experiments.style import COLORS, joined_plan
from trexton.companion.experiments.track import Track, tracks
from trexton.companion.wording import beside, distance, middle, number, percent
from trexton.flights.flight import Flight
from trexton.localization.localizer import TextonMap


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    repeats: int = option(RUNS["paper"], "independent runs of the filter over the test", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Train on one flight, localize every frame of another, compare with motion capture.

    With images, or with histograms; then `samples` and `textons` do not apply.
    """
    texton_map, runs, values, series = train_and_fly(train, test, parameters)
    floor, pictures = floor_picture(test)
    rank_std_cm = 100 * texton_map.parts["measurement"].deviations
    values |= {
        "drift_cm_per_min": drift(runs, test, rng=stream(parameters.seed, "drift")),
        "counts": {
            "train": len(texton_map.positions),
            "test": len(test),
            "test_s": test.time[-1] - test.time[0],
            "textons": texton_map.histograms.shape[1],
        },
        "spread": _spread(runs, test, stream(parameters.seed, "spread")),
        "lag": lag(runs, test),
        "model": {
            "first_rank_std_cm": rank_std_cm[0].mean(),
            "last_rank_std_cm": rank_std_cm[-1].mean(),
        },
    }
    if train.name == test.name:  # parts of one flight: trained on the later, tested on the earlier
        _, turned, exchanged, _ = train_and_fly(test, train, parameters)
        values["exchanged"] = {name: exchanged[name] for name in ("filter", "knn")} | {
            "drift_cm_per_min": drift(turned, train, rng=stream(parameters.seed, "drift")),
            "spread": _spread(turned, train, stream(parameters.seed, "spread")),
        }
    return parameters.record(
        train, test, values=values, series=series | whereabouts(train) | floor, images=pictures
    )


def train_and_fly(
    train: Flight, test: Flight, parameters: Any, positions: np.ndarray | None = None
) -> tuple[TextonMap, list[Track], dict[str, Any], dict[str, Any]]:
    """The map of a flight, its runs over another, their values and series beside the k-NN alone and
    the yardsticks.

    Parameters
    ----------
    train, test : Flight
    parameters : MapParameters
        With `repeats`, independent runs of the filter.
    positions : (N, 2) array, optional
        Train on these in place of motion capture.
    """
    texton_map = map_of(train, parameters, positions=positions)
    if positions is None:
        runs = flown(train, test, parameters, repeats=parameters.repeats, texton_map=texton_map)
    else:
        names = ("repeats", "seed", "samples", "particles")
        how = {name: getattr(parameters, name) for name in names}
        runs = tracks(texton_map, frames_of(test), times=test.time, **how)
    rng, known = stream(parameters.seed, "intervals"), texton_map.positions

    def summary(estimates: list[np.ndarray]) -> dict[str, Any]:
        return summarize(estimates, test.position, test.diagonal, rng=rng)

    shuffled = partial(shuffled_neighbors, known, len(test), parameters.neighbors, rng=rng)
    values = {
        "filter": errors_of(runs, test, parameters.seed),
        "knn": summary([run.knn for run in runs]),
        "constant_guess": summary([constant_guess(known, len(test))]),
        "shuffled_neighbors": summary([shuffled()]),
    }
    means = [np.abs(run.position - test.position).mean() for run in runs]
    typical = runs[int(np.argsort(means, kind="stable")[(len(means) - 1) // 2])]
    series = {
        "time_s": test.time - test.time[0],
        "start_s": test.time[0],
        "truth_m": test.position,
        "estimate_m": typical.position,
        "knn_m": typical.knn,
        "area_m": test.area,
    }
    return texton_map, runs, values, series


def _spread(runs: list[Track], test: Flight, rng: np.random.Generator) -> dict[str, Any]:
    """Is the particles' spread honest? Shares of the errors of an axis that it covers."""
    ratio = np.array(
        [np.abs(run.position - test.position) / np.maximum(run.spread, 1e-9) for run in runs]
    )
    return {
        "within_one": (ratio <= 1).mean(),
        "within_two": mean_with_interval((ratio <= 2).mean(axis=2), rng),
        "mean_cm": 100 * np.mean([run.spread for run in runs]),
    }


def finding(record: Record) -> str:
    """What the experiment found, in a few sentences."""
    values, lag, spread = record.values, record.values["lag"], record.values["spread"]
    error, knn = (middle(values[name]["mean_cm"]) for name in ("filter", "knn"))
    text = (
        f"The paper's filter has an error of {distance(values['filter']['mean_cm'])}, "
        f"{beside(error / knn)} the plain mean of its own neighbours."
    )
    if lag["error_cm"] < 0.8 * error:
        text += f" It trails the vehicle by {number(lag['s'])} s."
    share = middle(spread["within_two"])
    honest = "as it should" if share >= 0.9 else "and should cover 95 %"
    return f"{text} Twice its spread covers {percent(share)} of the errors, {honest}."


def floor_plan(record: Record) -> Figure:
    """Truth and estimate over the floor."""
    label = "estimate (every 5th frame)"
    return joined_plan(record, "estimate_m", label, COLORS["paper"], every=5)


EXPERIMENT = Experiment(
    "Training on measured positions", Parameters, run, finding, needs=POSITIONS, cost_s=40
)
