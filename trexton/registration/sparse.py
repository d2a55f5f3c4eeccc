"""Sparse matrices of layout and adjustment, by SciPy. Offers those that it has not: `differences`,
`steps`, `pick`, `assemble`, and `solve` for symmetric systems."""

from __future__ import annotations

from typing import Any

import numpy as np
from scipy import sparse
from scipy.sparse.csgraph import connected_components
from scipy.sparse.linalg import splu

__all__ = ["Sparse", "assemble", "connected", "differences", "pick", "solve", "steps"]

Sparse = Any  # one of SciPy's sparse arrays, which carry no types


def connected(count: int, pairs: np.ndarray) -> np.ndarray:
    """``(count,)`` number of the piece that each frame is of, joined by ``(L, 2)`` pairs."""
    graph = sparse.coo_array((np.ones(len(pairs)), tuple(pairs.T)), (count, count))
    return connected_components(graph, directed=False)[1]


def differences(count: int, order: int) -> Sparse:
    """``(count - order, count)`` finite differences of `order` 1 or 2."""
    stencil = {1: [-1.0, 1.0], 2: [1.0, -2.0, 1.0]}[order]
    if count <= order:
        return sparse.csr_array((0, count))
    return sparse.diags_array(stencil, offsets=range(order + 1), shape=(count - order, count))


def steps(count: int, pairs: np.ndarray) -> Sparse:
    """``(L, count)``: the second of each of the ``(L, 2)`` pairs minus the first."""
    rows = np.arange(len(pairs))
    values = np.repeat([-1.0, 1.0], len(pairs))
    return sparse.csr_array((values, (np.tile(rows, 2), pairs.T.ravel())), (len(pairs), count))


def pick(columns: np.ndarray, count: int, factor: float) -> Sparse:
    """``(len(columns), count)``: row i takes `factor` times entry ``columns[i]``."""
    rows = np.arange(len(columns))
    return sparse.csr_array((np.full(len(columns), factor), (rows, columns)), (len(columns), count))


def assemble(blocks: np.ndarray, pairs: np.ndarray, size: int, count: int) -> Sparse:
    """``(L, 2 size, 2 size)`` blocks of pairs, summed into ``(count size, count size)``."""
    places = (pairs[:, :, None] * size + np.arange(size)).reshape(len(pairs), 2 * size)
    down = np.repeat(places, 2 * size, axis=1).ravel()
    across = np.tile(places, (1, 2 * size)).ravel()
    return sparse.coo_array((blocks.ravel(), (down, across)), (count * size, count * size)).tocsc()


def solve(matrix: Sparse, vector: np.ndarray) -> np.ndarray:
    """The solution of a symmetric, positive definite system; `vector` may be complex."""
    # An ordering for symmetric matrices, without pivoting: far less fill than the general one.
    factors = splu(
        matrix.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
        options={"SymmetricMode": True},
    )  # fmt: skip
    if np.iscomplexobj(vector):
        return factors.solve(vector.real) + 1j * factors.solve(vector.imag)
    return factors.solve(vector)
