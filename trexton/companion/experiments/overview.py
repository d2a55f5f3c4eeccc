"""The pipeline on one real frame (paper, Introduction, overview): all that Algorithm 1 saw and
drew.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from trexton.base.errors import FlightError
from trexton.base.progress import progress
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import IMAGES, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import floor_picture, map_of
from trexton.companion.wording import distance
from trexton.evaluation.metrics import euclidean
from trexton.flights.flight import Flight
from trexton.localization.localizer import Estimate, Localizer
from trexton.vision.images import bgr_from_yuv
from trexton.vision.patches import gather_patches, sample_positions
from trexton.vision.textons import TextonDictionary

__all__ = ["EXPERIMENT", "finding", "Parameters", "run", "sampled_patches"]

_THUMBNAIL = 200  # pixels wide
_TRAIL_S = 4.0


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    frame: int | None = option(None, "number of the frame shown; None: that of the median error")


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Localize all frames of a flight and keep, of one, all that a picture of the method needs.

    Parameters
    ----------
    train, test : Flight
        With images.

    Raises
    ------
    FlightError
        The flight has no such frame, or no images.
    """
    texton_map = map_of(train, parameters)
    rng = stream(parameters.seed, "flight", 0)
    localizer = Localizer(
        texton_map, samples=parameters.samples, particles=parameters.particles, rng=rng
    )
    states, estimates = [], []
    for image in progress(test.images(), "localizing", len(test)):
        states.append(rng.bit_generator.state)
        estimates.append(localizer.step(image))
    track = np.array([estimate.position for estimate in estimates])
    errors = euclidean(track, test.position)
    row = _typical(errors) if parameters.frame is None else _row(test, parameters.frame)
    image, estimate = test.image(row), estimates[row]
    rng.bit_generator.state = states[row]
    drawn, labels = sampled_patches(image, texton_map.alphabet, parameters.samples, rng=rng)
    trail = np.flatnonzero((test.time <= test.time[row]) & (test.time >= test.time[row] - _TRAIL_S))
    floor, pictures = floor_picture(test)
    assert estimate.neighbors is not None  # the paper's method asks for them
    similar = estimate.neighbors.index
    offset = estimate.neighbors.position.mean(axis=0) - test.position[row]
    return parameters.record(
        train,
        test,
        values={
            "frame": test.frame[row],
            "time_s": test.time[row] - test.time[0],
            "error_cm": 100 * errors[row],
            "median_error_cm": 100 * np.median(errors),
            "neighbors_error_cm": 100 * np.hypot(*offset),
            "spread_cm": 100 * estimate.spread,
            "neighbors": {"frame": train.frame[similar], "distance": estimate.neighbors.distance},
            "image_shape": image.shape[:2],
            "patch": texton_map.alphabet.patch,
        },
        series={
            "patches": drawn,
            "labels": labels,
            "area_m": test.area,
            "truth_m": test.position[row],
            "truth_trail_m": test.position[trail],
            "estimate_trail_m": track[trail],
            **_belief(estimate),
            **floor,
        },
        images={
            **pictures,
            "frame": bgr_from_yuv(image),
            "textons": _texton_strip(texton_map.alphabet),
            "similar": np.concatenate(
                [_thumbnail(train.image(index)) for index in similar], axis=1
            ),
        },
    )


def sampled_patches(
    image: np.ndarray, dictionary: TextonDictionary, samples: int, *, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """Where `trexton.vision.histograms.sampled_histogram` looks with this `rng`, and what it finds.

    Returns
    -------
    positions : (n, 2) int array
        Row and column of each patch.
    labels : (n,) int array
        Nearest textons.
    """
    positions = sample_positions(image.shape, dictionary.patch, samples, rng)
    return positions, dictionary.label(gather_patches(image, positions, dictionary.patch))


def _belief(estimate: Estimate) -> dict[str, Any]:
    assert estimate.neighbors is not None
    return {
        "histogram": estimate.histogram,
        "neighbors_m": estimate.neighbors.position,
        "particles_m": estimate.particles,
        "weights": estimate.weights,
        "estimate_m": estimate.position,
        "covariance_m2": estimate.covariance,
    }


def _typical(errors: np.ndarray) -> int:
    """The row of the lower median error."""
    return int(np.argsort(errors, kind="stable")[(len(errors) - 1) // 2])


def _row(flight: Flight, frame: int) -> int:
    rows = np.flatnonzero(flight.frame == frame)
    if not len(rows):
        raise FlightError(
            f"flight {flight.name!r} has no frame {frame}: "
            f"choose one from {flight.frame[0]} to {flight.frame[-1]}, or None"
        )
    return int(rows[0])


def _texton_strip(dictionary: TextonDictionary) -> np.ndarray:
    """``(P, K P, 3) uint8`` BGR: all textons side by side."""
    return bgr_from_yuv(np.concatenate(list(dictionary.textons), axis=1))


def _thumbnail(image: np.ndarray) -> np.ndarray:
    rows, columns = image.shape[:2]
    size = (_THUMBNAIL, max(1, round(_THUMBNAIL * rows / columns)))
    return cv2.resize(bgr_from_yuv(image), size, interpolation=cv2.INTER_AREA)


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    values = record.values
    typical = ", that of the median error," if record.parameters["frame"] is None else ""
    count = len(values["neighbors"]["frame"])
    voted = "its nearest training frame" if count == 1 else f"the mean of its {count} neighbours"
    off, voted_off = values["error_cm"], values["neighbors_error_cm"]
    if distance(off) == distance(voted_off):  # no more is told apart than is said
        than = "as far as"
    else:
        than = "farther than" if off > voted_off else "nearer than"
    return (
        f"At frame {values['frame']}{typical} the filter is {distance(off)} off, {than} {voted} "
        f"({distance(voted_off)}), and claims a deviation of "
        f"{distance(np.hypot(*values['spread_cm']))}."
    )


EXPERIMENT = Experiment(
    "The pipeline in one picture", Parameters, run, finding, needs=IMAGES, cost_s=8
)
