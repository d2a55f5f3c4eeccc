"""Errors of a track of estimates: per axis as the paper prints them, Euclidean, with intervals and yardsticks.

Nothing is aligned before it is compared: estimates and ground truth share one frame of reference.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from trexton.errors import ParameterError

__all__ = ["block_bootstrap", "constant_guess", "errors", "shuffled_neighbors", "summarize", "wilson_interval"]


def errors(estimates: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """``(N, 2)`` absolute errors per axis in metres; NaN where either side is unknown.

    Raises
    ------
    ParameterError
        The shapes differ or are not (N, 2).
    """
    estimates, truth = np.asarray(estimates, dtype=float), np.asarray(truth, dtype=float)
    if estimates.shape != truth.shape or truth.ndim != 2 or truth.shape[1] != 2:
        raise ParameterError(f"estimates have shape {estimates.shape}, truth {truth.shape}: expected two (N, 2) arrays")
    return np.abs(estimates - truth)


def block_bootstrap(
    samples: np.ndarray, statistic: Callable[[np.ndarray], float], *, rng: np.random.Generator, block=12, draws=1000
) -> tuple[float, float]:
    """95 % interval of `statistic` over samples in time order, by resampling whole (circular) blocks.

    Neighbouring frames err alike; blocks of about a second keep that dependence, single frames would not.
    """
    count = len(samples)
    block = min(block, count)
    starts = rng.integers(count, size=(draws, -(-count // block)))
    rows = (starts[:, :, None] + np.arange(block)) % count
    values = [statistic(samples[row]) for row in rows.reshape(draws, -1)[:, :count]]
    low, high = np.percentile(values, (2.5, 97.5))
    return float(low), float(high)


def summarize(estimates: np.ndarray, truth: np.ndarray, diagonal: float, *, rng: np.random.Generator) -> dict:
    """Everything that tables print about one track.

    Parameters
    ----------
    estimates, truth : (N, 2) array
        Metres; rows with NaN are counted as missing and left out.
    diagonal : float
        Length of the area's diagonal in metres, for the relative error.

    Returns
    -------
    dict
        ``error_cm`` and ``std_cm`` with keys x and y (mean and standard deviation of the absolute error, the paper's
        two rows), their 95 % intervals ``error_cm_ci``, Euclidean ``mean_cm``, ``median_cm``, ``p95_cm``, ``rmse_cm``,
        ``mean_cm_ci``, ``relative`` (mean Euclidean error over the diagonal), ``frames`` and ``missing``.
    """
    absolute = errors(estimates, truth)
    known = np.isfinite(absolute).all(axis=1)
    absolute = 100 * absolute[known]
    counts = {"frames": int(known.sum()), "missing": int((~known).sum())}
    if not len(absolute):
        return counts
    euclidean = np.hypot(*absolute.T)
    axes = dict(zip("xy", absolute.T))
    return counts | {
        "error_cm": {axis: float(values.mean()) for axis, values in axes.items()},
        "std_cm": {axis: float(values.std()) for axis, values in axes.items()},
        "error_cm_ci": {axis: block_bootstrap(values, np.mean, rng=rng) for axis, values in axes.items()},
        "mean_cm": float(euclidean.mean()),
        "mean_cm_ci": block_bootstrap(euclidean, np.mean, rng=rng),
        "median_cm": float(np.median(euclidean)),
        "p95_cm": float(np.percentile(euclidean, 95)),
        "rmse_cm": float(np.sqrt(np.mean(euclidean**2))),
        "relative": float(euclidean.mean() / (100 * diagonal)) if diagonal > 0 else float("nan"),
    }


def constant_guess(train: np.ndarray, count: int) -> np.ndarray:
    """``(count, 2)`` the mean training position, always: what knowing nothing but the area costs."""
    return np.tile(np.nanmean(train, axis=0), (count, 1))


def shuffled_neighbors(positions: np.ndarray, count: int, k: int, *, rng: np.random.Generator) -> np.ndarray:
    """``(count, 2)`` means of k training positions drawn at random: the k-NN with its histograms shuffled."""
    return positions[rng.integers(len(positions), size=(count, k))].mean(axis=1)


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """95 % Wilson interval of a success rate."""
    if trials < 1 or not 0 <= successes <= trials:
        raise ParameterError(f"{successes} successes in {trials} trials: expected 0 <= successes <= trials, at least one trial")
    z, rate = 1.959963984540054, successes / trials
    center = (rate + z**2 / (2 * trials)) / (1 + z**2 / trials)
    half = z / (1 + z**2 / trials) * np.sqrt(rate * (1 - rate) / trials + z**2 / (4 * trials**2))
    return float(center - half), float(center + half)
