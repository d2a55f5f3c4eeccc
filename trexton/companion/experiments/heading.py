"""Any heading: what a turned camera costs a histogram of textons, and what two remedies bring.

Every picture of a flight is turned by any angle, and its position is asked from the others, which
are as they were flown. A rotation-tolerant dictionary counts a texton and its quarter turns as one;
a known heading turns the picture back first. What is turned keeps only the square that fits into
the picture at any angle, so the square as flown is shown too: it is what turning back costs.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from trexton.base.defaults import TEXTONS
from trexton.base.errors import ParameterError
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import IMAGES, Experiment, SeedParameters, option
from trexton.companion.experiments.evaluation import evenly_spread
from trexton.companion.experiments.style import (
    COLORS,
    canvas,
    label_rows,
    legend_above,
    with_intervals,
)
from trexton.companion.wording import distance
from trexton.evaluation.metrics import constant_guess, euclidean, mean_with_interval
from trexton.flights.flight import Flight
from trexton.localization.distances import Euclidean, Hellinger
from trexton.localization.neighbors import NearestHistograms, neighbors_in_flight
from trexton.vision.histograms import texton_histogram
from trexton.vision.textons import MAX_TEXTONS, TextonDictionary

# way to count: (distance, cells of a picture along each side)
COUNTS = {"paper": (Euclidean(), 1), "hellinger": (Hellinger(), 1), "cells": (Hellinger(), 2)}
# Hellinger's distance is that of method field.
MARKS: dict[str, tuple[str, dict[str, str]]] = {
    "paper": ("whole, the paper's distance", {"fmt": "o", "color": COLORS["paper"]}),
    "hellinger": ("whole, Hellinger's distance", {"fmt": "s", "color": COLORS["field"]}),
    "cells": (
        "2 x 2 cells, Hellinger's",
        {"fmt": "D", "color": COLORS["field"], "markerfacecolor": "white"},
    ),
}
VIEWS = {
    "whole": "whole picture, as flown",
    "square": "its square, as flown",
    "turned": "turned by any angle",
    "tolerant": "turned, tolerant dictionary",
    "back": "turned back by a compass",
}
PATCHES = 40_000  # that a dictionary is learned from, as many of every picture


@dataclass(frozen=True)
class Parameters(SeedParameters):
    """What can be chosen."""

    frames: int = option(150, "pictures, evenly over the training flight, at most", low=10)
    textons: int = option(TEXTONS, "textons of the dictionary, K", low=2, high=MAX_TEXTONS // 4)
    patch: int = option(6, "side of a patch in pixels", low=1)
    neighbors: int = option(3, "neighbours that vote, k", low=1)
    left_out: int = option(1, "pictures left out before and after the one that is asked", low=0)
    compass_deg: float = option(2.0, "standard deviation of the known heading", low=0)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Ask every picture's position from the others, as flown, turned, and with each remedy.

    Parameters
    ----------
    train, test : Flight
        Pictures and positions are those of `train`; `test` is not used.

    Raises
    ------
    ParameterError
        Fewer pictures with a position than neighbours and those left out.
    """
    rows = np.flatnonzero(train.located)
    rows = rows[evenly_spread(len(rows), parameters.frames)]
    flight = train.select(rows)
    if len(flight) < parameters.neighbors + 2 * parameters.left_out + 1:
        raise ParameterError(
            f"{len(flight)} pictures of flight {train.name!r} have a position: expected more than "
            f"{parameters.neighbors} neighbours and {2 * parameters.left_out} that are left out"
        )
    plain = TextonDictionary.learn(
        flight, parameters.textons, parameters.patch, rng=stream(parameters.seed, "training"),
        images=len(flight), patches_per_image=-(-PATCHES // len(flight)),
    )  # fmt: skip
    histograms = _histograms(flight, plain, parameters)
    truth = flight.position
    rng = stream(parameters.seed, "intervals")
    errors = {
        view: {count: 100 * _errors(histograms, view, count, truth, parameters) for count in COUNTS}
        for view in VIEWS
    }
    centre = euclidean(constant_guess(truth, len(truth)), truth)
    values: dict[str, Any] = {
        "error_cm": {
            view: {count: mean_with_interval(each[None], rng) for count, each in found.items()}
            for view, found in errors.items()
        },
        # picture by picture: the two share what is hard about a place
        "turning_cm": {
            count: mean_with_interval(
                (errors["turned"][count] - errors["square"][count])[None], rng
            )
            for count in COUNTS
        },
        "centre_cm": 100 * float(centre.mean()),
        "bound_cm": 100 * float(_bound(truth, parameters.left_out).mean()),
        "frames": len(flight),
    }
    return parameters.record(train, values=values)


def turned(image: np.ndarray, angle: float) -> np.ndarray:
    """The middle of a picture turned anticlockwise: the square that fits into it at any angle.

    Parameters
    ----------
    image : (H, W, 3) uint8 array
    angle : float
        Radians; at 0 the pixels are those of the picture.
    """
    height, width = image.shape[:2]
    side = int(min(height, width) / np.sqrt(2))
    if angle:
        about = ((width - 1) / 2, (height - 1) / 2)
        image = cv2.warpAffine(
            image, cv2.getRotationMatrix2D(about, np.degrees(angle), 1.0), (width, height)
        )
    top, left = (height - side) // 2, (width - side) // 2
    return np.ascontiguousarray(image[top : top + side, left : left + side])


def with_quarter_turns(dictionary: TextonDictionary) -> TextonDictionary:
    """Every texton at its four quarter turns, one after another: ``4 K`` textons."""
    turns = [np.rot90(dictionary.textons, quarter, axes=(1, 2)) for quarter in range(4)]
    return TextonDictionary(np.stack(turns, axis=1).reshape(-1, *dictionary.textons.shape[1:]))


def _histograms(
    flight: Flight, plain: TextonDictionary, parameters: Parameters
) -> dict[tuple[str, int], np.ndarray]:
    """``(N, K cells^2)`` by view and cells; of the tolerant dictionary asked and as flown."""
    rng = stream(parameters.seed, "headings")
    tolerant = with_quarter_turns(plain)
    histograms: dict[tuple[str, int], list[np.ndarray]] = {}
    for image in flight.images():
        angle, error = rng.uniform(-np.pi, np.pi), np.radians(rng.normal(0, parameters.compass_deg))
        square, aside = turned(image, 0.0), turned(image, angle)
        seen = {
            "whole": (image, plain), "square": (square, plain), "turned": (aside, plain),
            "back": (turned(image, error), plain), "tolerant": (aside, tolerant),
            "flown tolerant": (square, tolerant),
        }  # fmt: skip
        for view, (picture, dictionary) in seen.items():
            for cells in {cells for _, cells in COUNTS.values()}:
                counted = texton_histogram(picture, dictionary, cells=cells)
                folded = counted.reshape(-1, dictionary.n_textons // plain.n_textons).sum(axis=1)
                histograms.setdefault((view, cells), []).append(folded)
    return {key: np.stack(each) for key, each in histograms.items()}


def _errors(
    histograms: dict[tuple[str, int], np.ndarray],
    view: str,
    count: str,
    truth: np.ndarray,
    parameters: Parameters,
) -> np.ndarray:
    """``(N,)`` distances in metres of the mean of the neighbours of each picture from its place."""
    measure, cells = COUNTS[count]
    flown = {"whole": "whole", "tolerant": "flown tolerant"}.get(view, "square")
    k = parameters.neighbors
    nearest = NearestHistograms(histograms[flown, cells], truth, k, distance=measure)
    order = np.arange(len(truth), dtype=float)  # those left out are counted, not timed
    rows = neighbors_in_flight(nearest, histograms[view, cells], order, k, parameters.left_out)
    return euclidean(truth[rows].mean(axis=1), truth)


def _bound(truth: np.ndarray, left_out: int) -> np.ndarray:
    """``(N,)`` metres to the nearest picture that may be named: no answer of one can be better."""
    apart_m = euclidean(truth[:, None], truth)
    order = np.arange(len(truth))
    apart_m[np.abs(order[:, None] - order) <= left_out] = np.inf
    bound: np.ndarray = apart_m.min(axis=1)
    return bound


def notices(record: Record, count: str) -> bool:
    """Whether turned pictures err more than as flown, beyond chance."""
    return bool(record.values["turning_cm"][count]["low"] > 0)


def finding(record: Record) -> str:
    """What the experiment found, in two sentences."""
    errors = record.values["error_cm"]
    said = []
    for count, where in (("paper", "of whole pictures"), ("cells", "in 2 x 2 cells")):
        flown, aside = (errors[view][count]["value"] for view in ("square", "turned"))
        said.append(
            f"histograms {where} {'notice' if notices(record, count) else 'hardly notice'} it "
            f"({distance(aside)}, as flown {distance(flown)})"
        )
    back = errors["back"]["cells"]["value"]
    return (
        f"Where the camera is turned by any angle, {said[0]}, {said[1]}. With a known heading, by "
        f"which the picture is turned back, cells have {distance(back)}."
    )


def errors(record: Record) -> Figure:
    """Mean error with its interval, a line for each view, a mark for each way to count."""
    values = record.values
    with canvas(size=(7.2, 3.4)) as (figure, axes):
        plot = axes[0, 0]
        rows = np.arange(len(VIEWS))
        for place, (count, (label, mark)) in enumerate(MARKS.items()):
            each = [values["error_cm"][view][count] for view in VIEWS]
            places = rows + 0.2 * (place - 1)
            with_intervals(plot, places, each, across=True, scale=0.01, label=label, **mark)
        for name, label in (("bound_cm", "nearest picture"), ("centre_cm", "always the centre")):
            plot.axvline(values[name] / 100, color=COLORS["truth"], linestyle="--", linewidth=1)
            plot.annotate(
                label, (values[name] / 100, -0.5), xytext=(-3, -2), textcoords="offset points",
                rotation=90, ha="right", va="top", fontsize=8.5, color=COLORS["truth"],
            )  # fmt: skip
        label_rows(plot, VIEWS.values(), "mean error (m)")
        legend_above(plot, 2)
    return figure


def table(record: Record) -> pd.DataFrame:
    """Mean error with its interval, a row for each view, a column for each way to count."""
    errors = record.values["error_cm"]
    return pd.DataFrame(
        [
            {"picture": label}
            | {words: distance(errors[view][count]) for count, (words, _) in MARKS.items()}
            for view, label in VIEWS.items()
        ]
    )


EXPERIMENT = Experiment("Any heading", Parameters, run, finding, needs=IMAGES, cost_s=15)
