"""Errors of tracks of estimates: per axis as the paper prints them, Euclidean, with intervals and
yardsticks.

Nothing is aligned before it is compared: estimates and ground truth share one frame of reference.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from trexton.errors import ParameterError
from trexton.options import whole

__all__ = [
    "absolute_errors",
    "block_rows",
    "bootstrap_interval",
    "constant_guess",
    "mean_with_interval",
    "shuffled_neighbors",
    "success_rate",
    "summarize",
    "wilson_interval",
]

BLOCK = 12  # frames, about a second
_FEWEST = 4  # blocks of a flight
_AT_ONCE = 100_000  # drawn frames whose statistics are computed together


def absolute_errors(estimates: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """``(N, 2)`` absolute errors per axis in metres; NaN where either side is unknown.

    Raises
    ------
    ParameterError
        The shapes differ or are not (N, 2).
    """
    estimates, truth = np.asarray(estimates, dtype=float), np.asarray(truth, dtype=float)
    if estimates.shape != truth.shape or truth.ndim != 2 or truth.shape[1] != 2:
        raise ParameterError(
            f"estimates have shape {estimates.shape}, truth {truth.shape}: expected two (N, 2) "
            "arrays"
        )
    return np.abs(estimates - truth)


def block_rows(count: int, rng: np.random.Generator, block: int = BLOCK) -> np.ndarray:
    """``(count,)`` rows resampled in whole circular blocks.

    Neighbouring frames err alike; blocks of about a second keep that dependence, single frames
    would not. So few rows that they make no `_FEWEST` blocks are drawn in shorter ones.
    """
    block = _shortened(block, count)
    starts = rng.integers(count, size=-(-count // block))
    return ((starts[:, None] + np.arange(block)) % count).ravel()[:count]


def _shortened(block: int, count: int) -> int:
    """A block that fits `_FEWEST` times: of one that is the whole flight, all draws were alike."""
    return max(1, min(block, count // _FEWEST))


def bootstrap_interval(
    drawn: Sequence[Any] | np.ndarray, count: int, block: int = BLOCK
) -> np.ndarray:
    """95 % interval of a statistic of `count` rows, from its values where blocks were drawn anew.

    Percentiles, as far out as Student's t asks for so few blocks (the expanded percentile interval
    of Hesterberg, The American Statistician 69, 2015); plain ones hold less than they say.

    Parameters
    ----------
    drawn : (draws,) or (draws, K) array
        NaN where a draw has no value.
    count, block : int
        Rows in the sample, and in a block.

    Returns
    -------
    (2,) or (2, K) array
    """
    from scipy.stats import norm, t

    blocks = -(-count // _shortened(block, count))
    tail = 0.0
    if blocks > 1:
        tail = 100 * norm.sf(np.sqrt(blocks / (blocks - 1)) * t.isf(0.025, blocks - 1))
    return np.nanpercentile(drawn, (tail, 100 - tail), axis=0)


def mean_with_interval(
    rows: np.ndarray, rng: np.random.Generator, draws: int = 500
) -> dict[str, float]:
    """Mean of ``(R, N)`` values with its 95 % interval over runs and stretches of the flight, as
    records hold it; NaN is left out.

    Raises
    ------
    ParameterError
        There are no runs of frames.
    """
    if np.ndim(rows) != 2 or not np.size(rows):
        raise ParameterError(
            f"rows have shape {np.shape(rows)}: expected (R, N) values of runs and frames, "
            "one of each at least"
        )
    drawn = [
        np.nanmean(rows[rng.integers(len(rows))][block_rows(rows.shape[1], rng)])
        for _ in range(draws)
    ]
    low, high = bootstrap_interval(drawn, rows.shape[1])
    return {"median": np.nanmean(rows), "low": low, "high": high}


def _statistics(absolute: np.ndarray, diagonal_cm: float) -> dict[str, np.ndarray]:
    """All statistics of ``(D, N, 2)`` absolute errors in cm, each ``(D,)``: D tracks at once."""
    euclidean = np.hypot(absolute[..., 0], absolute[..., 1])
    mean, std = absolute.mean(axis=1), absolute.std(axis=1)
    overall = euclidean.mean(axis=1)
    return {
        "error_cm_x": mean[:, 0],
        "error_cm_y": mean[:, 1],
        "std_cm_x": std[:, 0],
        "std_cm_y": std[:, 1],
        "axis_mean_cm": mean.mean(axis=1),
        "axis_std_cm": std.mean(axis=1),
        "mean_cm": overall,
        "median_cm": np.median(euclidean, axis=1),
        "p95_cm": np.percentile(euclidean, 95, axis=1),
        "rmse_cm": np.sqrt(np.mean(euclidean**2, axis=1)),
        "relative": overall / diagonal_cm if diagonal_cm > 0 else np.full_like(overall, np.nan),
    }


def _of_each(absolute: np.ndarray, diagonal_cm: float) -> dict[str, np.ndarray]:
    """The statistics of ``(D, N, 2)`` errors, frames with NaN left out, tracks without any too."""
    known = np.isfinite(absolute).all(axis=2)
    if known.all():
        return _statistics(absolute, diagonal_cm)
    tracks = [track[rows][None] for track, rows in zip(absolute, known, strict=True) if rows.any()]
    return _joined([_statistics(track, diagonal_cm) for track in tracks])


def _joined(found: Sequence[dict[str, np.ndarray]]) -> dict[str, np.ndarray]:
    found = [each for each in found if each]
    return {name: np.concatenate([each[name] for each in found]) for name in (found or [{}])[0]}


def summarize(
    runs: Sequence[np.ndarray],
    truth: np.ndarray,
    diagonal: float,
    *,
    rng: np.random.Generator,
    draws: int = 1000,
) -> dict[str, Any]:
    """Everything that tables print about one or several runs over the same flight.

    Parameters
    ----------
    runs : sequence of (N, 2) array
        Estimates in metres; frames with NaN are counted as missing and left out.
    truth : (N, 2) array
        Metres.
    diagonal : float
        Length of the area's diagonal in metres, for the relative error.

    Returns
    -------
    dict
        For each statistic a dict: ``median`` over the runs, ``low`` and ``high`` (95 % interval: a
        run and blocks of frames are drawn anew each time), ``runs_low`` and ``runs_high`` (the same
        over the runs alone). The statistics are ``error_cm_*`` and ``std_cm_*`` for x and y (mean
        and standard deviation of the absolute error, the paper's two rows), their means over the
        axes ``axis_mean_cm`` and ``axis_std_cm``, and of the Euclidean error ``mean_cm``,
        ``median_cm``, ``p95_cm``, ``rmse_cm`` and ``relative`` (mean over diagonal). Further
        ``frames`` and ``missing``, counts a run on average.

    Raises
    ------
    ParameterError
        There are no runs, or the shapes differ.
    """
    if not len(runs):
        raise ParameterError("there are no runs to summarize: expected one (N, 2) array or more")
    draws = whole(draws, "draws")
    absolute = 100 * np.stack([absolute_errors(run, truth) for run in runs])
    missing = float((~np.isfinite(absolute).all(axis=2)).sum(axis=1).mean())
    result: dict[str, Any] = {
        "runs": len(runs),
        "frames": absolute.shape[1] - missing,
        "missing": missing,
    }
    if result["frames"] == 0:
        return result
    single = _of_each(absolute, 100 * diagonal)
    rows = [(rng.integers(len(absolute)), block_rows(absolute.shape[1], rng)) for _ in range(draws)]
    step = max(1, _AT_ONCE // absolute.shape[1])
    chunks = (
        np.stack([absolute[run, frames] for run, frames in rows[at : at + step]])
        for at in range(0, draws, step)
    )
    drawn = _joined([_of_each(chunk, 100 * diagonal) for chunk in chunks])
    for name, values in single.items():
        low, high = bootstrap_interval(drawn[name], absolute.shape[1])
        runs_low, median, runs_high = np.percentile(values, (2.5, 50, 97.5))
        result[name] = {
            "median": median,
            "low": low,
            "high": high,
            "runs_low": runs_low,
            "runs_high": runs_high,
        }
    return result


def constant_guess(train: np.ndarray, count: int) -> np.ndarray:
    """``(count, 2)`` the mean training position, always: what knowing nothing but the area
    costs.
    """
    return np.tile(np.nanmean(train, axis=0), (count, 1))


def shuffled_neighbors(
    positions: np.ndarray, count: int, k: int, *, rng: np.random.Generator
) -> np.ndarray:
    """``(count, 2)`` means of k training positions drawn at random: the k-NN with its histograms
    shuffled.
    """
    return positions[rng.integers(len(positions), size=(count, k))].mean(axis=1)


def success_rate(successes: int, trials: int) -> dict[str, Any] | None:
    """A rate with its 95 % Wilson interval, as records hold it; None without trials."""
    if not trials:
        return None
    low, high = wilson_interval(int(successes), trials)
    return {"median": successes / trials, "low": low, "high": high, "trials": trials}


def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """95 % Wilson interval of a success rate."""
    from scipy.stats import binomtest

    if trials < 1 or not 0 <= successes <= trials:
        raise ParameterError(
            f"{successes} successes in {trials} trials: expected 0 <= successes <= trials, at "
            "least one trial"
        )
    interval = binomtest(successes, trials).proportion_ci(method="wilson")
    return float(interval.low), float(interval.high)
