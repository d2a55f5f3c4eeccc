"""Simple baselines beside method `field`, on the features that it sees: a hidden Markov model,
weighted neighbours, a random forest and Gaussian processes from features to each coordinate.

Settings of each have the least error over stretches of the training flight that were left out; the
test flight is flown once. Of a single flight the parts are exchanged as well.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from time import process_time
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from scipy.spatial.distance import pdist
from sklearn.ensemble import RandomForestRegressor
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF
from sklearn.neighbors import KNeighborsRegressor

from trexton.base.defaults import SAMPLES
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import POSITIONS, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import coverage, drawn_histograms, flown, map_of
from trexton.companion.experiments.metrics import euclidean, summarize
from trexton.companion.experiments.style import COLORS, canvas, name_points, plain_log_ticks
from trexton.companion.experiments.track import ARRAYS, Track, fly
from trexton.companion.wording import lengths, middle, percent
from trexton.field.features import is_counted
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.methods import compose
from trexton.localization.neighbors import Hellinger
from trexton.localization.training import for_method, with_parts
from trexton.localization.training_set import EXCLUDED_SECONDS

FOLDS = 5
ALPHAS = (1.0, 0.6, 0.4, 0.25, 0.15)  # of the alpha-beta filter; 1: frames alone
PAUSE_S = 10.0  # between stretches of a test flight, over which no filter goes on
TIMED = 25  # frames that are timed one by one
WORTH = 0.9  # times the error of the best baseline: at most so much is an advantage
LABELS = {
    "paper": "the paper's filter",
    "more": "the same, 500 particles",
    "neighbors": "smoothed weighted neighbours",
    "gp": "smoothed Gaussian processes",
    "forest": "smoothed random forest",
    "hmm": "hidden Markov model",
    "field": "the field",
    "field_fixed": "the field without light and heading",
}
CLAIMS = (
    {
        "id": "beats-baselines",
        "place": "this project",
        "measure": "ratio of mean errors",
        "text": "The mean error of method field, of images without light and heading, is at most "
        ".9 times that of the best baseline",
        "kind": "below",
        "bound": WORTH,
        "ours": "baselines:ratio",
    },
)
# From features ``(M, d)`` to places ``(M, 2)``, and what makes one of training features, their
# places, and a setting.
Predictor = Callable[[np.ndarray], np.ndarray]
Regression = Callable[[np.ndarray, np.ndarray, Any], Predictor]


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    repeats: int = option(5, "independent runs with 500 particles", low=1)
    trees: int = option(40, "of the forest", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Train every baseline and the field on one flight, and locate the frames of another."""
    values, step_ms = compare(train, test, parameters)
    values["exchanged"] = compare(test, train, parameters)[0] if train.name == test.name else None
    return parameters.record(train, test, values=values, timings={"step_ms": step_ms})


def compare(
    train: Flight, test: Flight, parameters: Parameters
) -> tuple[dict[str, Any], dict[str, float]]:
    """Every method trained on one flight and flown over the stretches of another.

    Returns
    -------
    values : dict
        A summary of each method, the best of the simple ones, and the field's `ratio` to it.
    step_ms : dict of str to float
        CPU time of a frame whose features are at hand.
    """
    seed, located = parameters.seed, train.select(train.located)
    base = map_of(train, parameters)
    field = for_method(base, "field", flight=located)
    # Light and heading stay as surveyed: the baselines could not follow them in images.
    compared = "field_fixed" if test.has_images else "field"
    fixed = compose("field", {"appearance": "none"})["appearance"]
    field = with_parts(field, {"appearance": fixed})
    seen = drawn_histograms(test, field, parameters.samples, seed)
    hmm = with_parts(replace(field, method="hmm", parts={}), compose("hmm"))
    estimates, step_ms, held = {}, {}, {}
    pieces = np.split(np.arange(len(test)), np.flatnonzero(np.diff(test.time) > PAUSE_S) + 1)
    counted = parameters.samples if test.has_images else None
    whole = seen.reshape(len(seen), field.cells**2, -1).sum(axis=1)
    maps = {"paper": base, "more": base, "hmm": hmm, compared: field}
    particles = {"paper": parameters.particles, "more": 500}
    for name, texton_map in maps.items():
        runs = []
        for repeat in range(parameters.repeats if texton_map is base else 1):
            rng = stream(seed, f"baselines {name}", repeat)
            localizer = Localizer(texton_map, particles=particles.get(name), rng=rng)
            frames = whole if texton_map is base else seen
            run, step_ms[name] = _flown_over(pieces, localizer, frames, counted)
            runs.append(run)
        if name == "paper" and len(pieces) == 1:
            runs = flown(train, test, parameters, texton_map=base)  # what every page quotes
        estimates[name] = [run.position for run in runs]
        held[name] = coverage(runs, test, seed)
    for name, (regression, settings) in _regressions(parameters).items():
        predict, alpha = _chosen(regression, settings, field, stream(seed, "drawn"))
        places = [_smoothed(predict(seen[rows]), alpha) for rows in pieces]
        estimates[name] = [np.concatenate(places)]
        started = process_time()
        for each in seen[:TIMED]:
            predict(each[None])
        step_ms[name] = 1000 * (process_time() - started) / len(seen[:TIMED])
    values: dict[str, Any] = {}
    for name, runs_m in estimates.items():
        found = summarize(runs_m, test.position, test.diagonal, rng=stream(seed, "intervals"))
        values[name] = {"mean_cm": found["mean_cm"], "held": held.get(name)}
    simple = ("hmm", *_regressions(parameters))
    best = min(simple, key=lambda name: middle(values[name]["mean_cm"]))
    ratio = middle(values[compared]["mean_cm"]) / middle(values[best]["mean_cm"])
    return values | {"best": best, "compared": compared, "ratio": ratio}, step_ms


def _flown_over(
    pieces: list[np.ndarray], localizer: Localizer, frames: np.ndarray, counted: int | None
) -> tuple[Track, float]:
    """A run that starts anew with each of these rows of frames, and CPU milliseconds a frame."""
    started, parts = process_time(), []
    for rows in pieces:
        localizer.reset()
        parts.append(fly(localizer, frames[rows], counted=counted))
    step_ms = 1000 * (process_time() - started) / len(frames)
    joined: Any = (np.concatenate([getattr(part, name) for part in parts]) for name in ARRAYS)
    return Track(*joined), step_ms


def _regressions(parameters: Parameters) -> dict[str, tuple[Regression, list[Any]]]:
    """Each regression, and the settings that are tried."""
    return {
        "neighbors": (_neighbors, [(k, power) for k in (3, 5, 10, 20) for power in (1, 3)]),
        "gp": (_gaussian_processes, [(s, n) for s in (1.0, 2.0, 4.0) for n in (0.03, 0.1, 0.3)]),
        "forest": (partial(_forest, parameters.trees, parameters.seed), [2]),
    }


def _chosen(
    regression: Regression, settings: list[Any], texton_map: TextonMap, rng: np.random.Generator
) -> tuple[Predictor, float]:
    """The regression of a whole training set, and the alpha of its filter, with the settings that
    have the least error over left-out stretches.
    """
    places, time, rows = texton_map.positions, texton_map.time, texton_map.histograms
    counted = is_counted(rows, texton_map.cells**2)
    center, width = rows.mean(axis=0), rows.std(axis=0) + 1e-12

    def embed(values: np.ndarray) -> np.ndarray:
        """Roots of the bins of histograms; other values in units of their deviations."""
        return Hellinger().features(values) if counted else (values - center) / width

    if texton_map.dictionary is not None:  # drawn as a flight sees them
        shares = rows / rows.sum(axis=1, keepdims=True)
        rows = rng.multinomial(SAMPLES, shares) / SAMPLES * rows.sum(axis=1, keepdims=True)
    features = embed(rows)
    folds = np.array_split(np.arange(len(places)), FOLDS)
    tried: list[tuple[float, int, Any, float]] = []
    for setting in settings:
        found = []
        for fold in folds:
            first, last = time[fold[[0, -1]]] + np.array([-1, 1]) * EXCLUDED_SECONDS
            kept = (time < first) | (time > last)
            found.append(regression(features[kept], places[kept], setting)(features[fold]))
        for alpha in ALPHAS:
            smooth = np.concatenate([_smoothed(each, alpha) for each in found])
            tried.append((float(euclidean(smooth, places).mean()), len(tried), setting, alpha))
    _, _, setting, alpha = min(tried)
    predict = regression(features, places, setting)
    return lambda seen: predict(embed(seen)), alpha


def _smoothed(measured: np.ndarray, alpha: float) -> np.ndarray:
    """Places ``(N, 2)`` through an alpha-beta filter; beta after Kalata (1984)."""
    beta = alpha**2 / (2 - alpha) if alpha < 1 else 0.0
    place, velocity, result = measured[0], np.zeros(2), np.empty_like(measured)
    for row, each in enumerate(measured):
        innovation = each - (place + velocity)
        place = place + velocity + alpha * innovation
        velocity = velocity + beta * innovation
        result[row] = place
    return result


def _neighbors(features: np.ndarray, places: np.ndarray, setting: tuple[int, int]) -> Predictor:
    """The mean of the k nearest, weighted by a power of their closeness."""
    k, power = setting
    nearest = KNeighborsRegressor(k, weights=lambda apart: apart.clip(1e-9) ** -float(power))
    return nearest.fit(features, places).predict


def _gaussian_processes(
    features: np.ndarray, places: np.ndarray, setting: tuple[float, float]
) -> Predictor:
    """A Gaussian process a coordinate: squared exponential kernel, its length in median distances
    of features, and noise as a share of the signal variance.
    """
    scale, noise = setting
    kernel = RBF(scale * np.median(pdist(features)))
    process = GaussianProcessRegressor(kernel, alpha=noise, optimizer=None, normalize_y=True)
    return process.fit(features, places).predict


def _forest(
    trees: int, seed: int, features: np.ndarray, places: np.ndarray, leaf: int
) -> Predictor:
    """A random forest of both coordinates."""
    forest = RandomForestRegressor(
        trees, min_samples_leaf=leaf, max_features=1 / 3, random_state=seed, n_jobs=1
    )
    return forest.fit(features, places).predict


def finding(record: Record) -> str:
    """What the experiment found, in a sentence or two."""
    exchanged = record.values["exchanged"]
    after = f" With training and test exchanged: {verdict(exchanged)}" if exchanged else ""
    return verdict(record.values) + after


def verdict(values: Mapping[str, Any]) -> str:
    """Whether the field is worth its lines beside the best of the simple methods."""
    best, field = values[values["best"]], values[values["compared"]]
    subject, say = LABELS[values["compared"]].capitalize(), lengths(middle(field["mean_cm"]))
    beats = "beats" if values["ratio"] <= WORTH else "is not a tenth better than"
    return (
        f"{subject} {beats} the best simple baseline, the {LABELS[values['best']]}: "
        f"{say(field['mean_cm'])} against {say(best['mean_cm'])}."
    )


def table(record: Record) -> pd.DataFrame:
    """Mean error of every method, both ways where the flight was exchanged, and the share of
    positions in its 90 % region.
    """
    exchanged, step_ms = record.values["exchanged"], record.timings.get("step_ms", {})
    rows, say = [], lengths(middle(record.values[record.values["compared"]]["mean_cm"]))
    for name in filter(step_ms.__contains__, LABELS):
        row = {"method": LABELS[name], "mean error": say(record.values[name]["mean_cm"])}
        if exchanged:
            row["exchanged"] = say(exchanged[name]["mean_cm"])
        row["90 % region covers"] = percent(record.values[name]["held"])
        rows.append(row | {"CPU (ms a frame)": f"{step_ms[name]:.2g}"})
    return pd.DataFrame(rows)


def frontier(record: Record, labels: Mapping[str, str] = LABELS) -> Figure:
    """Mean error over the CPU time of a frame; the line joins those that none beats in both."""
    points = {
        name: (step_ms, middle(record.values[name]["mean_cm"]))
        for name, step_ms in record.timings["step_ms"].items()
    }
    with canvas(size=(7.2, 3.6)) as (figure, axes):
        plot = axes[0, 0]
        plot.set(xscale="log", yscale="log")
        plot.set(xlabel="CPU time of a frame (ms)", ylabel="mean error (cm)")
        edge: list[tuple[float, float]] = []
        for name, (cost, error) in sorted(points.items(), key=lambda each: each[1]):
            family = "paper" if name == "more" else name.partition("_")[0]
            plot.plot(cost, error, "o", color=COLORS.get(family, COLORS["zone"]))
            if not edge or error < edge[-1][1]:
                edge.append((cost, error))
        plot.step(*np.transpose(edge), where="post", color=COLORS["zone"], linewidth=0.8, zorder=0)
        plot.margins(x=0.12, y=0.18)
        name_points(plot, {labels[name]: place for name, place in points.items()})
        plain_log_ticks(plot.xaxis, plot.yaxis)
    return figure


EXPERIMENT = Experiment(
    "Simple baselines", Parameters, run, finding, POSITIONS, ("mocap_training",), claims=CLAIMS
)
