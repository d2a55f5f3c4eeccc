"""The best that the paper's own parameters give on a flight (Discussion: errors below 50 cm)."""

from __future__ import annotations

from itertools import product

import numpy as np

from trexton.experiments.evaluation import Track, tracks
from trexton.flights.flight import Flight
from trexton.histograms import sampled_histogram
from trexton.localizer import TextonMap
from trexton.metrics import absolute_errors, summarize
from trexton.progress import progress

__all__ = ["search_settings"]

PARTICLES = (50, 400)
NEIGHBORS = (1, 3, 5, 10)


def search_settings(
    texton_map: TextonMap, test: Flight, frames, full, *, samples: int, repeats: int, seed: int
) -> tuple[list[dict], dict]:
    """Try a grid of settings on a test flight.

    Parameters
    ----------
    texton_map : TextonMap
        Trained for as many neighbours as are to be tried.
    frames, full : sequence
        The test frames, and their histograms of full sampling.
    samples : int
        Tried beside full sampling, on flights with images. Runs of different particles and neighbours share their
        random samples, which are drawn once for each run.

    Returns
    -------
    grid : list of dict
        Every setting with its mean absolute error over both axes.
    best : dict
        ``best_error_cm``, the lowest of the grid: chosen on the flight it is measured on, and so a little too good;
        ``best_setting``; ``best``, all its statistics; ``best_held_out_cm``, chosen on one half of the flight and
        measured on the other, both ways.
    """
    runs = max(3, repeats // 3)
    sources = {None: [full] * runs}
    if test.has_images:
        rngs = [np.random.default_rng([seed, 30_000 + i]) for i in range(runs)]
        sources = {samples: [[sampled_histogram(image, texton_map.dictionary, samples, rng=rng) for image in frames] for rng in rngs]} | sources
    grid, errors, summaries = [], [], []
    neighbors = [k for k in NEIGHBORS if k <= texton_map.neighbors]
    for (drawn, histograms), m, k in progress(list(product(sources.items(), PARTICLES, neighbors)), "settings"):
        flown = [_fly(texton_map, one, seed + i, m, k) for i, one in enumerate(histograms)]
        rng = np.random.default_rng([seed, 30_100])
        summaries.append(summary := summarize([run.estimate for run in flown], test.position, test.diagonal, rng=rng, draws=400))
        grid.append({"samples": drawn, "particles": m, "neighbors": k, "axis_mean_cm": summary["axis_mean_cm"]})
        errors.append(np.median([100 * absolute_errors(run.estimate, test.position).mean(axis=1) for run in flown], axis=0))
    best = min(range(len(grid)), key=lambda i: grid[i]["axis_mean_cm"]["median"])
    return grid, {
        "best": summaries[best],
        "best_error_cm": grid[best]["axis_mean_cm"],
        "best_setting": {key: grid[best][key] for key in ("samples", "particles", "neighbors")},
        "best_held_out_cm": _held_out(np.array(errors)),
    }


def _fly(texton_map: TextonMap, histograms, seed: int, particles: int, neighbors: int) -> Track:
    (run,) = tracks(texton_map, histograms, repeats=1, seed=seed, particles=particles, neighbors=neighbors)
    return run


def _held_out(errors: np.ndarray) -> float:
    """Mean over the two halves of the flight of the error under the setting that is best on the other half."""
    halves = np.array_split(errors, 2, axis=1)
    return float(np.mean([mine[other.mean(axis=1).argmin()].mean() for mine, other in (halves, halves[::-1])]))
