"""Features of a histogram that a field follows: roots of frequencies or values, as they are or
along principal axes.

Roots of counts and frequencies have noise alike for rare and frequent bins (Bartlett 1936), and
distances of Hellinger. Values of which some are negative are taken as they are, in units of their
deviations. Whether features other than bins are turned to their principal axes (Jolliffe,
"Principal Component Analysis", 2002) is chosen by left-out blocks; very many always are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trexton.vision.histograms import SUM_TOLERANCE

MAX_FEATURES = 400  # more are taken along their principal axes
MAX_COMPONENTS = 125  # principal axes that are kept
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
    def candidates(cls, histograms: np.ndarray, parts: int = 1) -> list[Features]:
        """As a training flight's ``(N, K)`` histograms ask for; no axes where all are alike.

        Of histograms roots of the bins are taken, alike of each of several `parts` of an image. Of
        other values there is a choice: as they are, or along their principal axes.
        """
        counted, signed = is_counted(histograms, parts), bool((histograms < 0).any())
        values = _values(histograms, signed).reshape(len(histograms) * parts, -1)
        varying = np.flatnonzero(np.ptp(values, axis=0) > 1e-9 * np.abs(values).max(axis=0))
        # Of columns that are equal, which say nothing the second time, the first.
        first = {(values[:, column] + 0.0).tobytes(): column for column in varying[::-1]}
        used = np.array(sorted(first.values()), dtype=int)
        alone = np.eye(values.shape[1])[:, used]
        if parts > 1:
            if parts * len(used) > MAX_FEATURES:
                _, turn = np.linalg.eigh(np.cov(values[:, used].T))
                alone = alone @ turn[:, -(MAX_FEATURES // parts) :]
            return [cls(np.kron(np.eye(parts), alone), signed)]
        if signed:
            alone = alone / values[:, used].std(axis=0)
        many = len(used) > MAX_FEATURES
        if len(used) < 2 or counted and not many:
            return [cls(alone, signed)]
        variances, turn = np.linalg.eigh(np.cov((values @ alone).T))
        kept = variances > MIN_EIGENVALUE * variances[-1]
        kept[:-MAX_COMPONENTS] = False
        whitened = cls(alone @ (turn[:, kept] / np.sqrt(variances[kept])), signed)
        return [whitened] if many else [cls(alone, signed), whitened]

    def __call__(self, histograms: np.ndarray) -> np.ndarray:
        """``(..., d)`` features of ``(..., K)`` histograms."""
        return _values(histograms, self.signed) @ self.axes


def is_counted(histograms: np.ndarray, parts: int = 1) -> bool:
    """Whether ``(N, K)`` values are the bins of histograms, or of several `parts` of an image: not
    negative, and of one sum.
    """
    sums = histograms.sum(axis=1)
    alike = np.ptp(sums) <= SUM_TOLERANCE * sums.max()
    return parts > 1 or bool((histograms >= 0).all() and alike)


def _values(histograms: np.ndarray, signed: bool) -> np.ndarray:
    return histograms.astype(float) if signed else np.sqrt(np.maximum(histograms, 0))
