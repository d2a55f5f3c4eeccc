"""Distances between histograms: Euclidean, Hellinger, chi-square.

One that is the plain Euclidean distance of some features gives those, for the fast search; any
other gives its values. Training measures as flight does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trexton.localization.base import Part

__all__ = ["ChiSquare", "Distance", "Euclidean", "Hellinger"]


@dataclass(eq=False)
class Distance(Part):
    """Base of all distances between histograms: override `features`, or else `between`."""

    @property
    def embedded(self) -> bool:
        """Whether it is the Euclidean distance of `features`."""
        return type(self).between is Distance.between

    def features(self, histograms: np.ndarray) -> np.ndarray:
        """``(..., D)`` features of ``(..., K)`` histograms, whose Euclidean distance this is.

        A distance that has none leaves histograms as they are.
        """
        return histograms

    def between(self, queries: np.ndarray, rows: np.ndarray) -> np.ndarray:
        """``(M, N)`` distances of ``(M, K)`` histograms to ``(N, K)`` others."""
        offset = self.features(queries)[:, None] - self.features(rows)
        return np.sqrt(np.square(offset).sum(axis=-1))


@dataclass(eq=False)
class Euclidean(Distance):
    """Between the relative frequencies themselves (paper, Methods, "k-Nearest Neighbors")."""


@dataclass(eq=False)
class Hellinger(Distance):
    """Between square roots of the frequencies: counting noise becomes alike in all textons.

    Values below zero, of other features, keep their sign (Perronnin, Sanchez & Mensink 2010).
    """

    def features(self, histograms: np.ndarray) -> np.ndarray:
        return np.copysign(np.sqrt(np.abs(histograms) / 2), histograms)


@dataclass(eq=False)
class ChiSquare(Distance):
    """Half the sum of (a - b)^2 / (a + b) (Varma & Zisserman, "A statistical approach to texture
    classification from single images", IJCV 62, 2005).

    Textons that neither histogram has count nothing; features below zero count by their size.
    """

    def between(self, queries: np.ndarray, rows: np.ndarray) -> np.ndarray:
        offset = np.square(queries[:, None] - rows)
        total = np.abs(queries)[:, None] + np.abs(rows)
        return 0.5 * np.divide(offset, total, out=np.zeros_like(offset), where=total > 0).sum(
            axis=-1
        )
