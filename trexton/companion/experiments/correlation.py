"""Rank correlations with intervals that respect that neighbouring frames are alike.

Offers rank correlation over frames (block bootstrap) and over pairs of frames, and Pearson's.
"""

from typing import Any

import numpy as np

from trexton.companion.experiments.metrics import BLOCK, block_rows, with_interval


def rank_correlation(
    a: np.ndarray, b: np.ndarray, *, rng: np.random.Generator, draws: int = 400, block: int = BLOCK
) -> dict[str, Any]:
    """Spearman's correlation of two ``(N,)`` arrays: ``value``, ``low`` and ``high`` of its 95 %
    interval.

    The interval draws whole blocks of rows; `block` = 1 draws single rows. NaN where one side is
    constant.
    """
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    rows = np.stack([block_rows(len(a), rng, block) for _ in range(draws)])
    value, *drawn = _spearman(*(np.vstack([each[None], each[rows]]) for each in (a, b)))
    return with_interval(value, drawn, len(a), block)


def pair_correlation(
    a: np.ndarray, b: np.ndarray, *, rng: np.random.Generator, draws: int = 200
) -> dict[str, Any]:
    """Spearman's correlation of two symmetric ``(N, N)`` arrays over all pairs, with its 95 %
    interval.

    Frames, not pairs, are drawn anew in blocks: N (N - 1) / 2 pairs are far from independent. Ranks
    are kept.
    """
    count = len(a)
    x, y = (_pair_ranks(np.asarray(matrix, dtype=float)) for matrix in (a, b))
    terms = [1.0 - np.eye(count), x, y, x * x, y * y, x * y]

    def correlation(weights: np.ndarray) -> float:
        total, *sums = (
            np.einsum("i,i->", weights, np.einsum("ij,j->i", term, weights)) for term in terms
        )
        mean_x, mean_y, xx, yy, xy = (value / total for value in sums)
        return (xy - mean_x * mean_y) / np.sqrt((xx - mean_x**2) * (yy - mean_y**2))

    with np.errstate(invalid="ignore", divide="ignore"):
        drawn = [
            correlation(np.bincount(block_rows(count, rng), minlength=count).astype(float))
            for _ in range(draws)
        ]
        return with_interval(correlation(np.ones(count)), drawn, count)


def pearson(a: np.ndarray, b: np.ndarray) -> float:
    """Pearson's correlation, the same bits on any number of threads; NaN where one side is
    constant.
    """
    x, y = a - a.mean(), b - b.mean()
    with np.errstate(invalid="ignore"):
        return float(
            np.einsum("i,i->", x, y) / np.sqrt(np.einsum("i,i->", x, x) * np.einsum("i,i->", y, y))
        )


def _spearman(a: np.ndarray, b: np.ndarray) -> list[float]:
    """Of each row."""
    from scipy.stats import rankdata  # which takes half a second to load

    return [
        pearson(*ranks) for ranks in zip(*(rankdata(each, axis=1) for each in (a, b)), strict=True)
    ]


def _pair_ranks(matrix: np.ndarray) -> np.ndarray:
    """Ranks of the upper triangle, between -1/2 and 1/2, on both sides of a zero diagonal."""
    from scipy.stats import rankdata

    upper = np.triu_indices(len(matrix), 1)
    ranks = np.zeros_like(matrix)
    ranks[upper] = rankdata(matrix[upper]) / len(upper[0]) - 0.5
    return ranks + ranks.T
