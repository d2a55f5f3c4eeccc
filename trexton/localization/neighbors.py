"""The k most similar training histograms and where they were taken (Methods, "k-Nearest
Neighbors"), under one of several distances between histograms.

Exact; equal distances rank by index. A distance that is the plain Euclidean one of some features
gives those, for the fast search; any other gives its values. Training measures as flight does.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trexton.base.errors import MapError, ParameterError
from trexton.base.options import whole
from trexton.base.progress import progress
from trexton.localization.base import Part

_ROUNDING = 1e-12  # more than a sum of 256 products can be off


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


class Euclidean(Distance):
    """Between the relative frequencies themselves (paper, Methods, "k-Nearest Neighbors")."""


class Hellinger(Distance):
    """Between square roots of the frequencies: counting noise becomes alike in all textons.

    Values below zero, of other features, keep their sign (Perronnin, Sanchez & Mensink 2010).
    """

    def features(self, histograms: np.ndarray) -> np.ndarray:
        return np.copysign(np.sqrt(np.abs(histograms) / 2), histograms)


class ChiSquare(Distance):
    """Half the sum of (a - b)^2 / (a + b) (Varma & Zisserman, "A statistical approach to texture
    classification from single images", IJCV 62, 2005).

    Textons that neither histogram has count nothing; features below zero count by their size.
    """

    def between(self, queries: np.ndarray, rows: np.ndarray) -> np.ndarray:
        offset = np.square(queries[:, None] - rows)
        total = np.abs(queries)[:, None] + np.abs(rows)
        shares = np.divide(offset, total, out=np.zeros_like(offset), where=total > 0)
        return 0.5 * shares.sum(axis=-1)


@dataclass(frozen=True, eq=False, slots=True)
class Neighbors:
    """The k nearest histograms, nearest first.

    Attributes
    ----------
    index : (k,) int64 array
        Rows of the training set.
    distance : (k,) float64 array
        Between the histograms.
    position : (k, 2) float64 array, metres
    """

    index: np.ndarray
    distance: np.ndarray
    position: np.ndarray


class NearestHistograms:
    """Search structure over a training set.

    Parameters
    ----------
    histograms : (N, K) array
    positions : (N, 2) array, metres
    k : int
        Neighbours to return, at most N.
    distance : Distance, optional
        Euclidean unless given.

    Raises
    ------
    MapError
        Shapes disagree, or a histogram is not finite.
    ParameterError
        k is not between 1 and N.
    """

    def __init__(
        self,
        histograms: np.ndarray,
        positions: np.ndarray,
        k: int = 5,
        distance: Distance | None = None,
    ):
        histograms = np.asarray(histograms, dtype=np.float64)
        positions = np.array(positions, dtype=np.float64)
        fit = histograms.ndim == 2 and positions.shape == (len(histograms), 2)
        if not fit or not np.isfinite(histograms).all():
            raise MapError(
                "neighbours need finite (N, K) histograms and (N, 2) positions, "
                f"found {histograms.shape} and {positions.shape}: leave out frames without them"
            )
        if not 1 <= k <= len(histograms):
            raise ParameterError(
                f"k is {k}: expected 1 to {len(histograms)}, the training histograms"
            )
        self.positions, self.k, self.distance = positions, k, distance or Euclidean()
        self._shape = histograms.shape[1:]
        self._rows = self.distance.features(histograms)
        if self.distance.embedded:
            self._columns = np.array(self._rows.T, order="C")
            squared = np.einsum("ij,ij->i", self._rows, self._rows)
            self._half, self._largest = 0.5 * squared, squared.max()

    def query(self, histogram: np.ndarray, k: int | None = None) -> Neighbors:
        """The k nearest of one histogram ``(K,)``; another k, up to N, may be asked for.

        Raises
        ------
        MapError
            The histogram has another length than the training set's, or is not finite.
        """
        k = self.k if k is None else whole(k, "k", 1, len(self.positions))
        histogram = np.ascontiguousarray(histogram, dtype=np.float64)
        if histogram.shape != self._shape or not histogram @ histogram < np.inf:
            raise MapError(
                f"expected a finite histogram of {self._shape[0]} textons, "
                f"found shape {histogram.shape}: "
                "use the dictionary that the map was trained with"
            )
        if self.distance.embedded:
            index, apart = self._nearest(self.distance.features(histogram), k)
        else:
            apart = self.distance.between(histogram[None], self._rows)[0]
            index = apart.argsort(kind="stable")[:k]
            apart = apart.take(index)
        return Neighbors(index, apart, self.positions.take(index, axis=0))

    def _nearest(self, query: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
        """The k nearest rows and their distances, added up in the order of the textons."""
        candidates = self._candidates(query, k)
        difference = self._columns.take(candidates, axis=1)
        difference -= query[:, None]
        difference *= difference
        squared = np.add.reduce(difference, axis=0)
        order = squared.argsort(kind="stable")[:k]
        return candidates.take(order), np.sqrt(squared.take(order))

    def _candidates(self, query: np.ndarray, k: int) -> np.ndarray:
        """All rows that may be among the first k, rounding allowed for, in rising order."""
        closeness = self._half - query @ self._columns  # half the squared distance, less a constant
        margin = _ROUNDING * (query @ query + self._largest)
        return np.flatnonzero(closeness <= np.partition(closeness, k - 1)[k - 1] + margin)


def neighbors_in_flight(
    nearest: NearestHistograms, histograms: np.ndarray, time: np.ndarray, k: int, excluded_s: float
) -> np.ndarray:
    """``(N, k)`` rows of the nearest of the ``(N, K)`` histograms, over which `nearest` searches.

    Left out are frames at most `excluded_s` seconds away in the rising `time`; at 0 only the frame
    itself. Raises `MapError` where some frame has fewer than k others.
    """
    reach = excluded_s + 1e-9  # stamps are multiples of a period
    first = np.searchsorted(time, time - reach, side="left")
    last = np.searchsorted(time, time + reach, side="right")
    if (len(time) - (last - first)).min() < k:
        raise MapError(
            f"{len(time)} training frames over {time[-1] - time[0]:.1f} s leave fewer than {k} "
            f"neighbours outside {excluded_s} s of each: "
            "record a longer flight or ask for fewer neighbours"
        )
    result = np.empty((len(time), k), dtype=np.int64)
    for row in progress(range(len(time)), "neighbours", len(time)):
        rows = nearest.query(histograms[row], k + last[row] - first[row]).index
        result[row] = rows[(rows < first[row]) | (rows >= last[row])][:k]
    return result
