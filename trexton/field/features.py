"""Features of a histogram that a field follows: roots of frequencies or values, as they are or
along principal axes.

Roots of counts and frequencies have noise alike for rare and frequent bins (Bartlett 1936), and
distances of Hellinger. Values of which some are negative count nothing: they are taken as they are,
in units of their deviations. Features other than the bins of a histogram may say nearly the same;
those, and any that are very many, are taken along their principal axes (Jolliffe, "Principal
Component Analysis", 2002), in units of the deviation along each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trexton.flights.flight import SUM_TOLERANCE

__all__ = ["Features"]

MAX_FEATURES = 400  # more are taken along their principal axes
MAX_COMPONENTS = 125  # principal axes that are kept
REDUNDANCY = -2.0  # mean log eigenvalue below which features are taken along their principal axes
MIN_EIGENVALUE = 1e-6  # of an axis that is kept, as a share of the largest


@dataclass(frozen=True, eq=False)
class Features:
    """How features are taken from histograms.

    Attributes
    ----------
    axes : (K, d) array
        Directions in the space of roots or values.
    signed : bool
        Whether they are those of values, not of roots.
    """

    axes: np.ndarray
    signed: bool

    @classmethod
    def of(cls, histograms: np.ndarray, parts: int = 1) -> Features:
        """As a training flight's ``(N, K)`` histograms ask for; no axes where all are alike.

        Of histograms of several `parts` of an image roots of the bins are taken, alike of each.
        """
        signed = parts == 1 and bool((histograms < 0).any())
        values = _values(histograms, signed).reshape(len(histograms) * parts, -1)
        used = _informative(values)
        alone = np.eye(values.shape[1])[:, used]
        if parts > 1:
            if parts * len(used) > MAX_FEATURES:
                _, turn = np.linalg.eigh(np.cov(values[:, used].T))
                alone = alone @ turn[:, -(MAX_FEATURES // parts) :]
            return cls(np.kron(np.eye(parts), alone), signed)
        if not len(used):
            return cls(alone, signed)
        if signed:
            alone = alone / values[:, used].std(axis=0)
        covariance = np.cov((values @ alone).T).reshape(len(used), len(used))
        sums = histograms.sum(axis=1)
        bins = not signed and np.ptp(sums) <= SUM_TOLERANCE * sums.max()
        if len(used) <= MAX_FEATURES and (bins or _mean_log_eigenvalue(covariance) >= REDUNDANCY):
            return cls(alone, signed)
        variances, turn = np.linalg.eigh(covariance)
        kept = variances > MIN_EIGENVALUE * variances[-1]
        kept[:-MAX_COMPONENTS] = False
        return cls(alone @ (turn[:, kept] / np.sqrt(variances[kept])), signed)

    def __call__(self, histograms: np.ndarray) -> np.ndarray:
        """``(..., d)`` features of ``(..., K)`` histograms."""
        return _values(histograms, self.signed) @ self.axes


def _values(histograms: np.ndarray, signed: bool) -> np.ndarray:
    return histograms.astype(float) if signed else np.sqrt(np.maximum(histograms, 0))


def _informative(values: np.ndarray) -> np.ndarray:
    """Columns that vary; of those that are equal, which say nothing the second time, the first."""
    varying = np.flatnonzero(np.ptp(values, axis=0) > 1e-9 * np.abs(values).max(axis=0))
    _, first = np.unique(values[:, varying], axis=1, return_index=True)
    return varying[np.sort(first)]


def _mean_log_eigenvalue(covariance: np.ndarray) -> float:
    """Of the correlation matrix of a covariance; 0 where features are independent."""
    deviations = np.sqrt(np.diag(covariance))
    variances = np.linalg.eigvalsh(covariance / np.outer(deviations, deviations))
    return float(np.log(np.maximum(variances, MIN_EIGENVALUE)).mean())
