"""The k most similar histograms of the training set and where they were taken (Methods, "k-Nearest Neighbors").

Plain Euclidean distance, exact; equal distances rank by index. Few histograms are searched by brute force, many by a k-d
tree (SciPy, if installed), whose candidates are measured again with the same arithmetic, so that both give the same bits.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trexton.errors import MapError, ParameterError

__all__ = ["NearestHistograms", "Neighbors"]

TREE_FROM = 3000  # histograms from which the tree is quicker; measured by `trexton bench --stage neighbors`


@dataclass(frozen=True, eq=False)
class Neighbors:
    """The k nearest histograms, nearest first.

    Attributes
    ----------
    index : (k,) int64 array
        Rows of the training set.
    distance : (k,) float64 array
        Euclidean distance between relative frequencies.
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

    Raises
    ------
    MapError
        Shapes disagree, or a histogram is not finite.
    ParameterError
        k is not between 1 and N, or the method is unknown.
    """

    def __init__(self, histograms: np.ndarray, positions: np.ndarray, k: int = 5, method: str | None = None):
        histograms = np.array(histograms, dtype=np.float64, order="C")
        positions = np.array(positions, dtype=np.float64)
        if histograms.ndim != 2 or positions.shape != (len(histograms), 2) or not np.isfinite(histograms).all():
            raise MapError(
                f"neighbours need finite (N, K) histograms and (N, 2) positions, found {histograms.shape} and {positions.shape}: "
                "leave out frames without them"
            )
        if not 1 <= k <= len(histograms):
            raise ParameterError(f"k is {k}: expected 1 to {len(histograms)}, the number of training histograms")
        if method not in (None, "brute", "tree"):
            raise ParameterError(f"method {method!r} is unknown: choose brute or tree")
        self.histograms, self.positions, self.k = histograms, positions, k
        self._tree = _tree(histograms, required=method == "tree") if method != "brute" and (method or len(histograms) >= TREE_FROM) else None

    def query(self, histogram: np.ndarray) -> Neighbors:
        """The k nearest of one histogram ``(K,)``.

        Raises
        ------
        MapError
            The histogram has another length than the training set's, or is not finite.
        """
        histogram = np.asarray(histogram, dtype=np.float64)
        if histogram.shape != self.histograms.shape[1:] or not np.isfinite(histogram).all():
            raise MapError(
                f"expected a finite histogram of {self.histograms.shape[1]} textons, found shape {histogram.shape}: "
                "use the dictionary that the map was trained with"
            )
        if self._tree is None:
            squared = _squared_distances(self.histograms, histogram)
            candidates = np.argpartition(squared, self.k - 1)[: self.k]
            limit = squared[candidates].max()
            candidates = np.flatnonzero(squared <= limit)  # all that tie for the last place
            squared = squared[candidates]
        else:
            # The tree adds up in another order: take a hair more than its k-th distance, and measure again.
            farthest = self._tree.query(histogram, self.k)[0]
            radius = np.max(farthest) * (1 + 1e-9) + 1e-12
            candidates = np.sort(self._tree.query_ball_point(histogram, radius))
            squared = _squared_distances(self.histograms[candidates], histogram)
        order = np.argsort(squared, kind="stable")[: self.k]
        index = candidates[order]
        return Neighbors(index, np.sqrt(squared[order]), self.positions[index])


def _squared_distances(histograms: np.ndarray, histogram: np.ndarray) -> np.ndarray:
    difference = histograms - histogram
    return np.einsum("ij,ij->i", difference, difference)


def _tree(histograms: np.ndarray, required: bool):
    try:
        from scipy.spatial import cKDTree
    except ImportError:
        if required:
            raise ParameterError("method 'tree' needs SciPy, which cannot be imported: install it or choose 'brute'") from None
        return None
    return cKDTree(histograms)
