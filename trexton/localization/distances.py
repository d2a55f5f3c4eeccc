"""Distances between histograms: each maps them to a space in which plain Euclidean distance is that
distance.

So one search, brute force or tree, serves them all, and training measures as flight does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trexton.localization.base import Part

__all__ = ["Distance", "Euclidean", "Hellinger"]


@dataclass(eq=False)
class Distance(Part):
    """Base of all distances between histograms."""

    def features(self, histograms: np.ndarray) -> np.ndarray:
        """``(..., D)`` features of ``(..., K)`` histograms, whose Euclidean distance this is."""
        raise NotImplementedError


@dataclass(eq=False)
class Euclidean(Distance):
    """Between the relative frequencies themselves (paper, Methods, "k-Nearest Neighbors")."""

    def features(self, histograms: np.ndarray) -> np.ndarray:
        return histograms


@dataclass(eq=False)
class Hellinger(Distance):
    """Between square roots of the frequencies: counting noise becomes alike in all textons.

    Values below zero, of other features, keep their sign (Perronnin, Sanchez & Mensink 2010).
    """

    def features(self, histograms: np.ndarray) -> np.ndarray:
        roots: np.ndarray = np.copysign(np.sqrt(np.abs(histograms) / 2), histograms)
        return roots
