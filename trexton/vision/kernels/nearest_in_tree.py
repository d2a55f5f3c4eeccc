"""The k rows of a table nearest to a query, through a tree of boxes.

Differences are squared and added feature by feature without fused operations: the bits of NumPy, on
any processor.
"""

from __future__ import annotations

import numpy as np
from numba import njit

# Bounds are added in another order than distances: never prune by a rounding error.
_SLACK = 1 - 1e-12


@njit(cache=True, nogil=True)
def _squared_distances(columns, query, sums):
    """Of each row of a block, which is given transposed ``(K, size)`` so that its rows fill
    vectors.
    """
    sums[: columns.shape[1]] = 0
    for feature in range(len(query)):
        value, column = query[feature], columns[feature]
        for i in range(len(column)):
            difference = column[i] - value
            sums[i] += difference * difference


@njit(cache=True, nogil=True)
def _insert(row, distance, index, squared):
    """Keep the sorted lists sorted; for candidates that belong before the last."""
    place = len(squared) - 1
    while place > 0 and (distance, row) < (squared[place - 1], index[place - 1]):
        squared[place] = squared[place - 1]
        index[place] = index[place - 1]
        place -= 1
    squared[place] = distance
    index[place] = row


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract"})
def _box_bound(low, high, query):
    """Squared distance from a query to a box: no row inside is nearer."""
    total = 0.0
    for feature in range(len(query)):
        gap = max(max(low[feature] - query[feature], query[feature] - high[feature]), 0.0)
        total += gap * gap
    return total * _SLACK


@njit(cache=True, nogil=True)
def nearest_in_tree(low, high, leaves, rows, query, k):
    """``(k,)`` rows and squared distances, nearest first, equals by row; for
    `trexton.localization.neighbors.BoxTree`.
    """
    n_inner = len(low) - len(leaves)
    index, squared = np.full(k, rows.size), np.full(k, np.inf)
    sums = np.empty(leaves.shape[2])
    waiting, bounds = np.zeros(64, np.int64), np.zeros(64)
    top = 1
    while top > 0:  # the nearer child first: the other may turn out to be too far
        top -= 1
        node, bound = waiting[top], bounds[top]
        while bound <= squared[k - 1] and node < n_inner:
            node = 2 * node + 1
            bound = _box_bound(low[node], high[node], query)
            other = _box_bound(low[node + 1], high[node + 1], query)
            if other < bound:
                waiting[top], bounds[top], node, bound = node, bound, node + 1, other
            else:
                waiting[top], bounds[top] = node + 1, other
            top += 1
        if bound <= squared[k - 1]:
            leaf = node - n_inner
            _squared_distances(leaves[leaf], query, sums)
            for i in range(len(sums)):
                if (sums[i], rows[leaf, i]) < (squared[k - 1], index[k - 1]):
                    _insert(rows[leaf, i], sums[i], index, squared)
    return index, squared
