"""Errors of estimated tracks with 95 % confidence intervals.

Errors are per axis, as the paper prints them, and Euclidean; intervals come from a block bootstrap
with Student's t. Nothing is aligned before it is compared: estimates and ground truth
share one frame of reference.
"""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from scipy.special import ndtr, stdtrit

BLOCK = 12  # frames of a bootstrap block, about a second
_MIN_BLOCKS = 4  # of a flight


def euclidean(places: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Distances in metres between ``(..., 2)`` places, ``(...)`` as both broadcast."""
    return np.hypot(*np.moveaxis(places - others, -1, 0))


def block_rows(count: int, rng: np.random.Generator, block: int = BLOCK) -> np.ndarray:
    """``(count,)`` rows of one draw of the circular block bootstrap.

    Neighbouring frames err alike; blocks of about a second keep that dependence, single frames
    would not. So few rows that they make no `_MIN_BLOCKS` blocks are drawn in shorter ones.
    """
    block = _fitting(block, count)
    starts = rng.integers(count, size=-(-count // block))
    return ((starts[:, None] + np.arange(block)) % count).ravel()[:count]


def _fitting(block: int, count: int) -> int:
    """A block that fits `_MIN_BLOCKS` times: with one as long as the flight all draws are equal."""
    return max(1, min(block, count // _MIN_BLOCKS))


def with_interval(
    value: Any, drawn: Sequence[Any] | np.ndarray, count: int, block: int = BLOCK
) -> dict[str, Any]:
    """A statistic of `count` rows as records hold it, with its 95 % interval from its values where
    blocks were drawn anew.

    Percentiles, as far out as Student's t asks for so few blocks (the expanded percentile interval
    of Hesterberg, The American Statistician 69, 2015); plain ones hold less than they say.

    Parameters
    ----------
    drawn : (draws,) or (draws, K) array
        NaN where a draw has no value; where none has, nor have the ends of the interval.
    count, block : int
        Rows in the sample, and in a block.
    """
    blocks = -(-count // _fitting(block, count))
    tail, low, high = 0.0, np.nan, np.nan
    if blocks > 1:
        tail = 100 * ndtr(np.sqrt(blocks / (blocks - 1)) * stdtrit(blocks - 1, 0.025))
    if np.isfinite(drawn).any():
        low, high = np.nanpercentile(drawn, (tail, 100 - tail), axis=0)
    return {"value": value, "low": low, "high": high}


def mean_with_interval(rows: np.ndarray, rng: np.random.Generator) -> dict[str, float]:
    """Mean of ``(R, N)`` values with its 95 % interval over runs and stretches of the flight, as
    records hold it; NaN is left out.
    """
    runs, count = rows.shape
    drawn = [rows[rng.integers(runs), block_rows(count, rng)] for _ in range(500)]
    return with_interval(np.nanmean(rows), np.nanmean(np.stack(drawn), axis=1), count)


def _statistics(absolute: np.ndarray, diagonal_cm: float) -> dict[str, np.ndarray]:
    """Statistics of ``(T, N, 2)`` errors in cm, ``(T,)`` each: one of each track."""
    distance = np.hypot(absolute[..., 0], absolute[..., 1])
    mean, std, overall = absolute.mean(axis=1), absolute.std(axis=1), distance.mean(axis=1)
    return {
        "error_cm_x": mean[:, 0],
        "error_cm_y": mean[:, 1],
        "std_cm_x": std[:, 0],
        "std_cm_y": std[:, 1],
        "axis_mean_cm": mean.mean(axis=1),
        "axis_std_cm": std.mean(axis=1),
        "mean_cm": overall,
        "median_cm": np.median(distance, axis=1),
        "p95_cm": np.percentile(distance, 95, axis=1),
        "rmse_cm": np.sqrt(np.mean(distance**2, axis=1)),
        "relative": overall / (diagonal_cm if diagonal_cm > 0 else np.nan),
    }


def _of_tracks(tracks: Iterable[np.ndarray], diagonal_cm: float) -> dict[str, np.ndarray]:
    """Statistics of ``(N, 2)`` errors in cm, NaN left out; tracks of which none is left have none.

    Those of equal length, which are nearly all, are reckoned at once.
    """
    by_length: dict[int, list[np.ndarray]] = {}
    for track in tracks:
        left = track[np.isfinite(track).all(axis=1)]
        by_length.setdefault(len(left), []).append(left)
    by_length.pop(0, None)
    found = [_statistics(np.stack(alike), diagonal_cm) for alike in by_length.values()]
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
    truth : (N, 2) array, metres
    diagonal : float
        Length of the area's diagonal in metres, for the relative error.

    Returns
    -------
    dict
        For each statistic an entry: ``value``, its median over the runs, ``low`` and ``high`` (95 %
        interval: a run and blocks of frames are drawn anew each time). The statistics are
        ``error_cm_*`` and ``std_cm_*`` for x and y (mean and standard deviation of the absolute
        error, the paper's two rows), their means over the axes ``axis_mean_cm`` and
        ``axis_std_cm``, and of the Euclidean error ``mean_cm``, ``median_cm``, ``p95_cm``,
        ``rmse_cm`` and ``relative`` (mean over diagonal). Further ``frames`` and ``missing``,
        counts a run on average.
    """
    absolute = 100 * np.stack([np.abs(run - truth) for run in runs])
    missing = float((~np.isfinite(absolute).all(axis=2)).sum(axis=1).mean())
    count = absolute.shape[1]
    result: dict[str, Any] = {"runs": len(runs), "frames": count - missing, "missing": missing}
    if count == missing:
        return result
    drawn = [absolute[rng.integers(len(runs)), block_rows(count, rng)] for _ in range(draws)]
    of_runs, of_draws = (_of_tracks(tracks, 100 * diagonal) for tracks in (absolute, drawn))
    for name, values in of_runs.items():
        result[name] = with_interval(np.percentile(values, 50), of_draws.get(name, []), count)
    return result
