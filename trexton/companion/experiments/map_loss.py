"""Which floors are suitable (paper, Methods, "Map evaluation" and its figure). Does the loss
predict errors?
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments import style
from trexton.companion.experiments.correlation import pair_correlation, rank_correlation
from trexton.companion.experiments.declaration import POSITIONS, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import evenly_spread, floor_picture, flown, map_of
from trexton.companion.experiments.metrics import euclidean
from trexton.companion.experiments.similarity import (
    cosine_similarity,
    heat_map,
    local_losses,
    smooth,
)
from trexton.companion.experiments.style import COLORS, canvas, floor_axes, length_unit, show_floor
from trexton.companion.wording import number, span
from trexton.flights.flight import Flight
from trexton.localization.localizer import TextonMap
from trexton.localization.training_set import EXCLUDED_SECONDS, training_set

AUTHORS = 0.8  # sigma in metres
PAIRED_FRAMES = 1000  # at most so many, evenly spaced, where all pairs are compared


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    sigma: float | None = option(
        None,
        f"of ideal similarity and smoothing, in metres; without it the authors' {AUTHORS}, and "
        "over a field a tenth of its diagonal",
        above=0,
    )


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Evaluate the training set of one flight, and compare its loss with the errors that are then
    made.

    Two kinds of error: on the training flight each frame is localized by its k-NN among the others,
    those within half a second left out; on the test flight by the k-NN and by the filter. There the
    loss is that of the place, smoothed from the training samples around it.
    """
    texton_map = map_of(train, parameters)
    histograms, positions = texton_map.histograms, texton_map.positions
    sigma = parameters.sigma or usual_sigma(train.diagonal)
    losses = local_losses(histograms, positions, sigma)
    rows = training_set(texton_map).neighbors(parameters.neighbors, EXCLUDED_SECONDS)
    errors = euclidean(positions[rows].mean(axis=1), positions)
    half, double = (local_losses(histograms, positions, factor * sigma) for factor in (0.5, 2))
    rng = stream(parameters.seed, "parts")
    prediction = {"correlation": rank_correlation(losses, errors, rng=rng)}
    prediction |= _in_flight(texton_map, train, test, losses, sigma, parameters)
    floor, pictures = floor_picture(train)
    return parameters.record(
        train,
        test,
        values={
            "global_loss": losses.mean(),
            "similarity": _similarity(histograms, positions, parameters.seed),
            "prediction": prediction,
            "sigma": {
                "used_m": sigma,
                "rank_correlation": rank_correlation(
                    half, double, rng=stream(parameters.seed, "sigma")
                ),
                "half_sigma_loss": half.mean(),
                "double_sigma_loss": double.mean(),
            },
            "counts": {"train": len(histograms), "test": len(test), "textons": histograms.shape[1]},
        },
        series={
            "area_m": train.area,
            "positions_m": positions,
            "local_loss": losses,
            "error_m": errors,
            "heat": {
                "loss": heat_map(losses, positions, train.area, sigma).round(5),
                "error_m": heat_map(errors, positions, train.area, sigma).round(5),
            },
            **floor,
        },
        images=pictures,
    )


def _similarity(histograms: np.ndarray, positions: np.ndarray, seed: int) -> dict[str, Any]:
    """Actual similarity of all pairs of frames against their distance."""
    rows = evenly_spread(len(histograms), PAIRED_FRAMES)
    alike, place = cosine_similarity(histograms[rows]), positions[rows]
    distance = euclidean(place[:, None], place)
    rng = stream(seed, "similarity")
    return {
        "lowest": alike.min(),
        "mean": alike.mean(),
        "distance_correlation": pair_correlation(alike, distance, rng=rng),
    }


def _in_flight(
    texton_map: TextonMap,
    train: Flight,
    test: Flight,
    losses: np.ndarray,
    sigma: float,
    parameters: Parameters,
) -> dict[str, Any]:
    """Correlations of another flight: the smoothed loss of each place, its mean error."""
    expected = smooth(losses, texton_map.positions, test.position, sigma)
    runs = flown(train, test, parameters, texton_map=texton_map)
    errors = {
        "test_knn": np.mean([euclidean(run.knn, test.position) for run in runs], axis=0),
        "test_filter": np.mean([run.errors(test.position) for run in runs], axis=0),
    }
    rng = stream(parameters.seed, "unseen")
    return {name: rank_correlation(expected, wrong, rng=rng) for name, wrong in errors.items()}


def usual_sigma(diagonal: float) -> float:
    """Metres: as it served the authors' hall, and over a field a tenth of its diagonal."""
    return max(AUTHORS, float(f"{0.1 * diagonal:.1g}"))  # one digit: it is no exact number


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    prediction = record.values["prediction"]
    cases = {
        "on the training flight": prediction["correlation"],
        "of the filter in flight": prediction["test_filter"],
    }
    if None in (entry["value"] for entry in cases.values()):
        return (
            "Here the paper's loss cannot be compared with errors. Frames lie farther apart than "
            f"sigma reaches, which was {number(record.values['sigma']['used_m'])} m."
        )
    parts = [f"{_verdict(it)} the errors {where} ({span(it, 2)})" for where, it in cases.items()]
    joined = "and" if len({_verdict(entry) for entry in cases.values()}) == 1 else "but"
    return f"By rank correlation the paper's loss {parts[0]} {joined} {parts[1]}."


def _verdict(entry: dict[str, Any]) -> str:
    """What a rank correlation of loss and error says of the loss."""
    if entry["low"] > 0:
        return "predicts"
    return "goes against" if entry["high"] < 0 else "is not shown to predict"


def heat_maps(record: Record) -> Figure:
    """The smoothed loss over the floor, and beside it the smoothed error of the k-NN."""
    heat, positions = record.series["heat"], np.array(record.series["positions_m"])
    unit, scale = length_unit(float(np.median(record.series["error_m"])))
    panels = (("Loss", "loss", 1, ""), ("Error of the k-NN alone", "error_m", scale, f" ({unit})"))
    with canvas(1, 2, size=(7.2, 4.0), sharey=True) as (figure, axes):
        for plan, (title, key, scale, unit) in zip(axes[0], panels, strict=True):
            floor_axes(plan, record.series["area_m"])
            show_floor(plan, record.series.get("floor"), record.images.get("floor"), fade=0.3)
            label = f"smoothed {key.removesuffix('_m')}{unit}"
            values = scale * np.array(heat[key], dtype=float)
            style.heat_map(
                figure, plan, values, record.series["area_m"], label, location="bottom", aspect=25
            )
            plan.plot(*positions.T, ".", color=COLORS["truth"], markersize=1.2, alpha=0.6)
            plan.set_title(title)
        axes[0, 1].set_ylabel("")
    return figure


EXPERIMENT = Experiment(
    "Which floors are suitable: the map loss", Parameters, run, finding, needs=POSITIONS, cost_s=20
)
