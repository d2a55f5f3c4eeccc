"""The best that the paper's own parameters give on a flight (Discussion: errors below 50 cm)."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np

from trexton.experiments.evaluation import tracks
from trexton.flights.flight import Flight
from trexton.histograms import sampled_histogram
from trexton.localizer import TextonMap
from trexton.metrics import absolute_errors, summarize
from trexton.progress import progress
from trexton.streams import stream

__all__ = ["search_settings"]

PARTICLES = (50, 400)
NEIGHBORS = (1, 3, 5, 10)


def search_settings(
    texton_map: TextonMap,
    test: Flight,
    frames: Any,
    full: Any,
    *,
    samples: int,
    repeats: int,
    seed: int,
) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Try a grid of settings on a test flight.

    Parameters
    ----------
    texton_map : TextonMap
        Trained for as many neighbours as are to be tried.
    frames, full : sequence
        The test frames, and their histograms of full sampling.
    samples : int
        Tried beside full sampling, on flights with images. Runs of different particles and
        neighbours share
        their random samples, which are drawn once for each run.

    Returns
    -------
    grid : list of dict
        Every setting with its mean absolute error over both axes.
    best : dict
        ``best_error_cm``, the lowest of the grid: chosen on the flight it is measured on, a little
        too good;
        ``best_setting``; ``best``, all its statistics; ``best_held_out_cm``, chosen on one half of
        the flight
        and measured on the other, both ways.
    """
    flights: dict[int | None, list[list[np.ndarray]]] = {None: [full] * max(3, repeats // 3)}
    if test.has_images:
        rngs = [stream(seed, "samples", i) for i in range(len(flights[None]))]
        drawn_once: dict[int | None, list[list[np.ndarray]]] = {
            samples: [_sampled(frames, texton_map, samples, rng) for rng in rngs]
        }
        flights = drawn_once | flights
    counts = [k for k in NEIGHBORS if k <= texton_map.neighbors]
    grid, summaries, errors = [], [], []
    for (drawn, flown), m, k in progress(
        list(product(flights.items(), PARTICLES, counts)), "settings"
    ):
        estimates = [_fly(texton_map, one, seed, i, m, k) for i, one in enumerate(flown)]
        rng = stream(seed, "intervals")
        summary = summarize(estimates, test.position, test.diagonal, rng=rng, draws=400)
        summaries.append(summary)
        grid.append(
            {
                "samples": drawn,
                "particles": m,
                "neighbors": k,
                "axis_mean_cm": summary["axis_mean_cm"],
            }
        )
        single = [100 * absolute_errors(one, test.position).mean(axis=1) for one in estimates]
        errors.append(np.median(single, axis=0))
    best = min(range(len(grid)), key=lambda i: grid[i]["axis_mean_cm"]["median"])
    return grid, {
        "best": summaries[best],
        "best_error_cm": grid[best]["axis_mean_cm"],
        "best_setting": {key: grid[best][key] for key in ("samples", "particles", "neighbors")},
        "best_held_out_cm": _held_out(np.array(errors)),
    }


def _sampled(
    images: list[np.ndarray], texton_map: TextonMap, samples: int, rng: np.random.Generator
) -> list[np.ndarray]:
    return [sampled_histogram(image, texton_map.alphabet, samples, rng=rng) for image in images]


def _fly(
    texton_map: TextonMap,
    histograms: Sequence[np.ndarray],
    seed: int,
    number: int,
    particles: int,
    neighbors: int,
) -> np.ndarray:
    options = {"particles": particles, "neighbors": neighbors}
    (run,) = tracks(texton_map, histograms, repeats=1, seed=seed, first=number, **options)
    return run.estimate


def _held_out(errors: np.ndarray) -> float:
    """Mean over both halves of the flight of the error under the setting that is best on the other
    half.
    """
    first, second = np.array_split(errors, 2, axis=1)
    chosen = [
        mine[other.mean(axis=1).argmin()].mean()
        for mine, other in ((first, second), (second, first))
    ]
    return float(np.mean(chosen))
