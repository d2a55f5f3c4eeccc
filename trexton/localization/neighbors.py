"""The k most similar training histograms and where they were taken (Methods, "k-Nearest
Neighbors").

Exact; equal distances rank by index. Euclidean distance, between the histograms or what another
distance makes of them. Few histograms are searched by brute force in NumPy, many through a tree of
bounding boxes, with the same arithmetic in the end and therefore the same bits. (SciPy's k-d tree
spends more on a call than a whole search takes here, and leaves the order of equals open.)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from trexton.base.errors import MapError, ParameterError
from trexton.base.progress import progress
from trexton.localization.distances import Distance

__all__ = ["BoxTree", "NearestHistograms", "Neighbors", "neighbors_in_flight"]

METHODS = ("brute", "tree")
TREE_FROM = 5000  # histograms: the tree is no quicker with fewer, and loads numba
LEAF = 32  # rows in a leaf, at most
SPREAD = 64  # rows that show how wide a node is
_ROUNDING = 1e-12  # more than a sum of 256 products can be off


@dataclass(frozen=True, eq=False, slots=True)
class Neighbors:
    """The k nearest histograms, nearest first.

    Attributes
    ----------
    index : (k,) int64 array
        Rows of the training set.
    distance : (k,) float64 array
        Between the histograms.
    position : (k, 2) float64 array
        Metres.
    """

    index: np.ndarray
    distance: np.ndarray
    position: np.ndarray


class NearestHistograms:
    """Search structure over a training set.

    Parameters
    ----------
    histograms : (N, K) array
    positions : (N, 2) array
        Metres.
    k : int
        Neighbours to return, at most N.
    method : {"brute", "tree"} or None
        None chooses by N.
    distance : Distance, optional
        Euclidean unless given.

    Raises
    ------
    MapError
        Shapes disagree, or a histogram is not finite.
    ParameterError
        k is not between 1 and N, or the method is unknown.
    """

    def __init__(
        self,
        histograms: np.ndarray,
        positions: np.ndarray,
        k: int = 5,
        method: str | None = None,
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
        if method not in (None, *METHODS):
            raise ParameterError(
                f"method {method!r} is unknown: choose one of {', '.join(METHODS)}"
            )
        self.positions, self.k, self.distance = positions, k, distance
        self._shape = histograms.shape[1:]
        if distance is not None:
            histograms = distance.features(histograms)
        wanted = method == "tree" or (method is None and len(histograms) >= TREE_FROM)
        self._rows = None if distance is None or distance.embedded else histograms
        wanted = wanted and self._rows is None
        self._tree = BoxTree.build(histograms) if wanted else None
        self._columns = None if wanted else _Columns(histograms)

    def query(self, histogram: np.ndarray, k: int | None = None) -> Neighbors:
        """The k nearest of one histogram ``(K,)``; another k, up to N, may be asked for.

        Raises
        ------
        MapError
            The histogram has another length than the training set's, or is not finite.
        """
        k = self.k if k is None else k
        histogram = np.ascontiguousarray(histogram, dtype=np.float64)
        size = histogram @ histogram if histogram.shape == self._shape else np.nan
        if not size < np.inf:
            raise MapError(
                f"expected a finite histogram of {self._shape[0]} textons, "
                f"found shape {histogram.shape}: "
                "use the dictionary that the map was trained with"
            )
        if self.distance is not None:
            histogram = np.ascontiguousarray(self.distance.features(histogram))
            size = histogram @ histogram
        if self._rows is not None and self.distance is not None:
            apart = self.distance.between(histogram[None], self._rows)[0]
            index = apart.argsort(kind="stable")[:k]
            return Neighbors(index, apart.take(index), self.positions.take(index, axis=0))
        if self._columns is not None:
            index, squared = self._columns.nearest(histogram, float(size), k)
        else:
            from trexton.vision.kernels.nearest_in_tree import nearest_in_tree  # loads numba

            tree: Any = self._tree
            index, squared = nearest_in_tree(
                tree.low, tree.high, tree.leaves, tree.rows, histogram, k
            )
        return Neighbors(index, np.sqrt(squared), self.positions.take(index, axis=0))


def neighbors_in_flight(
    nearest: NearestHistograms,
    histograms: np.ndarray,
    time: np.ndarray,
    k: int,
    excluded_s: float,
) -> np.ndarray:
    """``(N, k)`` rows of the nearest histograms of each frame, itself and its neighbours in time
    left out.

    Parameters
    ----------
    nearest : NearestHistograms
        Over the same ``(N, K)`` histograms.
    time : (N,) array
        Seconds, rising.
    excluded_s : float
        Frames at most so far away in time are left out; at 0 only the frame itself.

    Raises
    ------
    MapError
        Some frame has fewer than k others outside the excluded time.
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
        found = nearest.query(histograms[row], k + last[row] - first[row]).index
        result[row] = found[(found < first[row]) | (found >= last[row])][:k]
    return result


class _Columns:
    """Brute force: a matrix product finds candidates, whose distances are then measured exactly."""

    def __init__(self, table: np.ndarray):
        self.columns = np.array(table.T, order="C")
        squared = np.einsum("ij,ij->i", table, table)
        self.half, self.largest = 0.5 * squared, squared.max()

    def nearest(self, query: np.ndarray, size: float, k: int) -> tuple[np.ndarray, np.ndarray]:
        """The k nearest rows and their squared distances; `size` is the squared length of the
        query.
        """
        closeness = self.half - query @ self.columns  # half the squared distance, less a constant
        margin = _ROUNDING * (size + self.largest)
        if k < len(closeness):
            candidates = closeness.argpartition(k)[: k + 1]
            rows, squared = self._rank(candidates, query)
            if squared[k] - squared[k - 1] > margin:
                return rows[:k], squared[:k]
        # The k-th and the next are as good as equal: look at all that may belong to the first k.
        limit = np.partition(closeness, k - 1)[k - 1] + margin
        rows, squared = self._rank(np.flatnonzero(closeness <= limit), query)
        return rows[:k], squared[:k]

    def _rank(self, candidates: np.ndarray, query: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        candidates.sort()
        difference = self.columns.take(candidates, axis=1)
        difference -= query[:, None]
        difference *= difference
        # Texton after texton, as the compiled kernel does.
        squared = np.add.reduce(difference, axis=0)
        order = squared.argsort(kind="stable")
        return candidates.take(order), squared.take(order)


@dataclass(frozen=True, eq=False)
class BoxTree:
    """A complete binary tree of bounding boxes: a node splits its rows at the median of its widest
    feature.

    Attributes
    ----------
    low, high : (2 L - 1, K) arrays
        Corners of the box of each node; node i has the children 2 i + 1 and 2 i + 2, the last L
        nodes are leaves.
    leaves : (L, K, S) array
        The S rows of each leaf, transposed; infinite where there is none.
    rows : (L, S) int64 array
        Which rows they are.
    """

    low: np.ndarray
    high: np.ndarray
    leaves: np.ndarray
    rows: np.ndarray

    @classmethod
    def build(cls, table: np.ndarray) -> BoxTree:
        """The tree of the rows of a table ``(N, K)``, N at least 1."""
        n = len(table)
        depth = max(0, int(np.ceil(np.log2(n / LEAF))))
        size = -(-n // 2**depth)
        rows = np.arange(size * 2**depth).reshape(1, -1)  # rows from n on stand for none
        for _ in range(depth):
            width = rows.shape[1]
            known = np.minimum(rows, n - 1)
            widest = np.ptp(table[known[:, :: max(1, width // SPREAD)]], axis=1).argmax(axis=1)
            order = np.argpartition(table[known, widest[:, None]], width // 2, axis=1)
            rows = np.take_along_axis(rows, order, axis=1).reshape(-1, width // 2)
        known = np.minimum(rows, n - 1)
        leaves = np.ascontiguousarray(table[known].transpose(0, 2, 1))
        low, high = [leaves.min(axis=2)], [leaves.max(axis=2)]
        while len(low[0]) > 1:
            low.insert(0, np.minimum(low[0][::2], low[0][1::2]))
            high.insert(0, np.maximum(high[0][::2], high[0][1::2]))
        leaves[np.broadcast_to((rows >= n)[:, None], leaves.shape)] = np.inf
        return cls(np.concatenate(low), np.concatenate(high), leaves, known)
