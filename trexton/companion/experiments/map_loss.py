"""Which floors are suitable (paper, Methods, "Map evaluation" and its figure), whether the loss
predicts errors.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments import style
from trexton.companion.experiments.correlation import pair_correlation, pearson, rank_correlation
from trexton.companion.experiments.declaration import POSITIONS, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import evenly_spread, floor_picture, frames_of, map_of
from trexton.companion.experiments.style import (
    COLORS,
    SERIES,
    band,
    canvas,
    floor_axes,
    legend_below,
    length_unit,
    show_floor,
)
from trexton.companion.experiments.track import fly
from trexton.companion.wording import interval, number
from trexton.evaluation.metrics import block_rows, bootstrap_interval, euclidean
from trexton.evaluation.suitability import (
    cosine_similarity,
    heat_map,
    ideal_similarity,
    local_losses,
    smooth,
    usual_sigma,
)
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.training import training_set
from trexton.localization.training_set import EXCLUDED_SECONDS

AUTHORS = 0.8  # sigma in metres
SWEPT = (0.125, 0.25, 0.375, 0.5, 0.75, 1, 1.5, 2, 3, 4)  # times the usual sigma
PAIRED_FRAMES = 1000  # at most so many, evenly spaced, where all pairs are compared
GROUPS = 10


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    sigma: float = option(
        0.0,
        f"of ideal similarity and smoothing, in metres; 0 is the authors' {AUTHORS}, and over a "
        "field a tenth of its diagonal",
        low=0,
    )


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Evaluate the training set of one flight, and compare its loss with the errors that are then
    made.

    Two kinds of error: on the training flight each frame is localized by its k-NN among the others,
    those within half a second left out; on the test flight by the k-NN and by the filter. There the
    loss is that of the place, smoothed from the training samples around it.

    Parameters
    ----------
    train, test : Flight
        With images, or with histograms.
    """
    texton_map = map_of(train, parameters)
    histograms, positions = texton_map.histograms, texton_map.positions
    usual = usual_sigma(train.diagonal, AUTHORS)
    sigma = parameters.sigma or usual
    losses = local_losses(histograms, positions, sigma)
    rows = training_set(texton_map).neighbors(parameters.neighbors, EXCLUDED_SECONDS)
    errors = euclidean(positions[rows].mean(axis=1), positions)
    similarity, similarity_series = _similarity(histograms, positions, parameters.seed)
    sigmas = [round(share * usual, 4) for share in SWEPT]
    sweep, chosen = _sweep(histograms, positions, errors, sigma, sigmas, parameters.seed)
    prediction, prediction_series = _prediction(positions, losses, errors, sigma, parameters.seed)
    options = {"samples": parameters.samples, "particles": parameters.particles}
    unseen, unseen_series = _unseen(texton_map, test, losses, sigma, options, parameters.seed)
    heat = heat_map(losses, positions, train.area, sigma)
    wrong = heat_map(errors, positions, train.area, sigma)
    floor, pictures = floor_picture(train)
    return parameters.record(
        train,
        test,
        values={
            "global_loss": losses.mean(),
            "similarity": similarity,
            "prediction": prediction | unseen,
            "sigma": chosen | {"used_m": sigma},
            "counts": {"train": len(histograms), "test": len(test), "textons": histograms.shape[1]},
        },
        series={
            "area_m": train.area,
            "positions_m": positions,
            "local_loss": losses,
            "error_m": errors,
            "heat": {
                "loss": heat.round(5),
                "error_m": wrong.round(5),
                "extent_m": train.area,
            },
            "sweep": sweep,
            "similarity": similarity_series,
            "groups": prediction_series | unseen_series,
            **floor,
        },
        images=pictures,
    )


def _similarity(
    histograms: np.ndarray, positions: np.ndarray, seed: int
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Actual similarity of all pairs of frames against their distance."""
    rows = evenly_spread(len(histograms), PAIRED_FRAMES)
    alike, place = cosine_similarity(histograms[rows]), positions[rows]
    distance = euclidean(place[:, None], place)
    rng = stream(seed, "similarity")
    values = {
        "lowest": alike.min(),
        "mean": alike.mean(),
        "distance_correlation": pair_correlation(alike, distance, rng=rng),
    }
    upper = np.triu_indices(len(rows), 1)
    edges = np.linspace(0, distance.max(), 25)
    bins = np.digitize(distance[upper], edges[1:-1])
    groups = [alike[upper][bins == b] for b in range(24)]
    quartiles = [
        np.percentile(group, (25, 50, 75)) if len(group) else [np.nan] * 3 for group in groups
    ]
    low, median, high = np.array(quartiles).T
    return values, {
        "distance_m": (edges[1:] + edges[:-1]) / 2,
        "low": low,
        "median": median,
        "high": high,
    }


def _sweep(
    histograms: np.ndarray,
    positions: np.ndarray,
    errors: np.ndarray,
    sigma: float,
    others: list[float],
    seed: int,
) -> tuple[list[Any], dict[str, Any]]:
    """What another sigma would have given."""
    frames = evenly_spread(len(histograms), PAIRED_FRAMES)
    alike, place = cosine_similarity(histograms[frames]), positions[frames]
    upper = np.triu_indices(len(frames), 1)
    default = local_losses(histograms, positions, sigma)
    sweep = []
    for value in others:
        losses = local_losses(histograms, positions, value)
        ideal = ideal_similarity(place, place, value)
        sweep.append(
            {
                "sigma_m": value,
                "global_loss": losses.mean(),
                "agreement": pearson(alike[upper], ideal[upper]),
                "prediction": rank_correlation(losses, errors, rng=stream(seed, "prediction")),
                "same_order": rank_correlation(losses, default, rng=stream(seed, "same order")),
            }
        )
    half, double = (local_losses(histograms, positions, factor * sigma) for factor in (0.5, 2))
    return sweep, {
        "rank_correlation": rank_correlation(half, double, rng=stream(seed, "sigma")),
        "best_agreement_m": max(sweep, key=lambda row: row["agreement"])["sigma_m"],
        "half_sigma_loss": half.mean(),
        "double_sigma_loss": double.mean(),
    }


def _prediction(
    positions: np.ndarray, losses: np.ndarray, errors: np.ndarray, sigma: float, seed: int
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Does the loss of a training frame tell its error, and which part of the loss does?

    The loss is mean similarity less mean ideal, and the ideal knows nothing of the floor: its mean
    only counts the frames around each frame, so it is small at the border and wherever few frames
    were taken.
    """
    crowding = ideal_similarity(positions, positions, sigma).mean(axis=1)

    def correlation(a: np.ndarray, b: np.ndarray) -> Any:
        return rank_correlation(a, b, rng=stream(seed, "parts"))

    values = {
        "correlation": correlation(losses, errors),
        "similarity_alone": correlation(losses + crowding, errors),
        "sparseness_alone": correlation(-crowding, errors),
    }
    return values, {"train_knn": _grouped(losses, errors, seed)}


def _unseen(
    texton_map: TextonMap,
    test: Flight,
    losses: np.ndarray,
    sigma: float,
    options: dict[str, Any],
    seed: int,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The same on another flight: the smoothed loss of each place against the errors made there."""
    expected = smooth(losses, texton_map.positions, test.position, sigma)
    track = fly(Localizer(texton_map, rng=stream(seed, "flight"), **options), frames_of(test))
    errors = {
        "test_knn": euclidean(track.knn, test.position),
        "test_filter": track.errors(test.position),
    }
    rng = stream(seed, "unseen")
    values = {name: rank_correlation(expected, wrong, rng=rng) for name, wrong in errors.items()}
    return values, {name: _grouped(expected, wrong, seed) for name, wrong in errors.items()}


def _grouped(losses: np.ndarray, errors: np.ndarray, seed: int) -> list[dict[str, Any]]:
    """Mean error in cm in tenths of the frames by rising loss, intervals over stretches of the
    flight.
    """
    order = np.argsort(losses, kind="stable")
    group = np.empty(len(order), dtype=np.int64)
    group[order] = np.arange(len(order)) * GROUPS // len(order)
    rng = stream(seed, "groups")

    def means(values: np.ndarray, rows: np.ndarray) -> np.ndarray:
        with np.errstate(invalid="ignore"):
            return np.bincount(group[rows], values[rows], GROUPS) / np.bincount(
                group[rows], minlength=GROUPS
            )

    drawn = [means(100 * errors, block_rows(len(errors), rng)) for _ in range(400)]
    low, high = bootstrap_interval(drawn, len(errors))
    loss, error = (means(values, np.arange(len(order))) for values in (losses, 100 * errors))
    return [
        {"loss": loss[i], "error_cm": {"value": error[i], "low": low[i], "high": high[i]}}
        for i in range(GROUPS)
    ]


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    prediction = record.values["prediction"]
    cases = {
        "on the training flight": prediction["correlation"],
        "of the filter in flight": prediction["test_filter"],
    }
    if None in (entry["value"] for entry in cases.values()):
        return (
            "Here the paper's loss cannot be compared with errors: frames lie farther apart than "
            f"sigma reaches, which was {number(record.values['sigma']['used_m'])} m."
        )
    said = {
        where: "predicts"
        if entry["low"] > 0
        else "misleads on"
        if entry["high"] < 0
        else "does not tell"
        for where, entry in cases.items()
    }
    parts = [
        f"{said[where]} the errors {where} (rank correlation {interval(entry)})"
        for where, entry in cases.items()
    ]
    alone = prediction["sparseness_alone"]
    predicts = said["on the training flight"] == "predicts"
    if alone["low"] > 0:
        does = "does too" if predicts else "does"
    else:
        does = "does not" if predicts else "does not either"
    parts.append(f"on the training flight being far from other frames {does} ({interval(alone)})")
    joined = "and" if len(set(said.values())) == 1 else "but"
    return f"The paper's loss {parts[0]} {joined} {parts[1]}; {parts[2]}."


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
                figure, plan, values, heat["extent_m"], label, location="bottom", aspect=25
            )
            plan.plot(*positions.T, ".", color=COLORS["truth"], markersize=1.2, alpha=0.6)
            plan.set_title(title)
        axes[0, 1].set_ylabel("")
    return figure


def errors_by_loss(record: Record) -> Figure:
    """Mean error in tenths of the frames, ordered by loss: one that predicts gives rising lines."""
    lines = (
        ("train_knn", "training frames, k-NN without the frame", COLORS["neighbors"], "o--"),
        ("test_knn", "test flight, k-NN", COLORS["neighbors"], "s-"),
        ("test_filter", "test flight, particle filter", COLORS["paper"], "^-"),
    )
    unit, scale = length_unit(float(np.median(record.series["error_m"])))
    with canvas(size=(6.4, 3.6)) as (figure, axes):
        plot = axes[0, 0]
        for key, label, color, stroke in lines:
            rows = record.series["groups"][key]
            # A tenth of very few frames may hold none: its numbers are missing.
            loss = np.array([row["loss"] for row in rows], dtype=float)
            error = {
                name: scale / 100 * np.array([row["error_cm"][name] for row in rows], dtype=float)
                for name in ("value", "low", "high")
            }
            band(
                plot, loss, error["low"], error["value"], error["high"], color=color,
                marker=stroke[0], linestyle=stroke[1:], markersize=4, label=label,
            )  # fmt: skip
        plot.set(xlabel="loss of the frame or its place", ylabel=f"Euclidean error ({unit})")
        plot.set_ylim(0, None)
        legend_below(plot, 0.2)
    return figure


def similarity_by_distance(record: Record) -> Figure:
    """Similarity of pairs of frames by distance, median and quartiles, and the ideal."""
    series, sigma = record.series["similarity"], record.values["sigma"]["used_m"]
    distance = np.array(series["distance_m"])
    low, median, high = (np.array(series[key], dtype=float) for key in ("low", "median", "high"))
    with canvas(size=(6.4, 3.2)) as (figure, axes):
        plot = axes[0, 0]
        half = "half of all pairs"
        plot.fill_between(distance, low, high, color=SERIES[0], alpha=0.2, linewidth=0, label=half)
        plot.plot(distance, median, label="median", color=SERIES[0])
        curve = np.linspace(0, distance.max(), 200)
        ideal = np.exp(-(curve**2) / (2 * sigma**2))
        plot.plot(curve, ideal, color=SERIES[1], linestyle="--", label=f"ideal, σ = {sigma:g} m")
        plot.set(xlabel="distance (m)", ylabel="cosine similarity", xlim=(0, None), ylim=(0, 1.02))
        legend_below(plot, 0.2, columns=3)
    return figure


def sigma_sweep(record: Record) -> Figure:
    """The global loss, and three correlations, against sigma."""
    sweep, default = record.series["sweep"], record.values["sigma"]["used_m"]
    sigma = [row["sigma_m"] for row in sweep]
    lines = (
        ("agreement", "actual and ideal similarity", SERIES[2], "o"),
        ("prediction", "loss and k-NN error (ranks)", SERIES[0], "s"),
        ("same_order", f"loss at σ and at {default:g} m (ranks)", SERIES[1], "^"),
    )
    with canvas(2, 1, size=(6.4, 4.8), sharex=True, height_ratios=(1, 2)) as (figure, axes):
        loss, plot = axes[:, 0]
        losses = [row["global_loss"] for row in sweep]
        loss.plot(sigma, losses, color=COLORS["truth"], marker="o", markersize=4)
        loss.set(ylabel="global loss L")
        for key, label, color, marker in lines:
            values = [row[key] for row in sweep]
            if isinstance(values[0], dict):
                low, high = (
                    np.array([row[end] for row in values], dtype=float) for end in ("low", "high")
                )
                plot.fill_between(sigma, low, high, color=color, alpha=0.15, linewidth=0)
                values = [row["value"] for row in values]
            drawn = np.array(values, dtype=float)
            plot.plot(sigma, drawn, color=color, marker=marker, markersize=4, label=label)
        plot.set(xlabel="σ (m)", ylabel="correlation", xscale="log", ylim=(None, 1.05))
        plot.set_xticks(sigma, labels=[f"{value:.3g}" for value in sigma])
        plot.minorticks_off()
        for axis in (loss, plot):
            axis.axvline(default, color=COLORS["truth"], linestyle=":", linewidth=1.2)
            axis.axhline(0, color="#999999", linewidth=0.8)
        legend_below(plot, 0.2)
    return figure


EXPERIMENT = Experiment(
    "Which floors are suitable: the map loss", Parameters, run, finding, needs=POSITIONS, cost_s=20
)
