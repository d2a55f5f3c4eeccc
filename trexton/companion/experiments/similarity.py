"""Map evaluation: how well a floor suits the method, from a training set alone (Methods, "Map
evaluation"). The loss is what the similarity of histograms exceeds a Gaussian bump around every
position by, negative where it falls short.

Throughout, `histograms` is ``(N, K)``, `positions` is ``(N, 2)`` in metres, `sigma` is in metres
and raises `ParameterError` unless it is positive.
"""

import numpy as np

from trexton.base.errors import MapError
from trexton.base.options import number

_FINEST, _CELLS = 0.05, 200  # side of a cell in metres, cells along a side
_ROWS = 512  # rows of an (N, N) matrix that are held at once


def cosine_similarity(histograms: np.ndarray) -> np.ndarray:
    """``(N, N)``: CS(h_i, h_j), between 0 and 1 for histograms.

    Raises
    ------
    MapError
        A histogram is all zero, or not finite.
    """
    units = _units(histograms)
    return np.einsum("ik,jk->ij", units, units)


def ideal_similarity(positions: np.ndarray, others: np.ndarray, sigma: float) -> np.ndarray:
    """``(N, M)``: d_e, the product of one unnormalised Gaussian an axis, 1 at no distance."""
    sigma = number(sigma, "sigma in metres", above=0)
    x, y = np.asarray(positions).T / sigma
    others_x, others_y = np.asarray(others).T / sigma
    return np.exp(-(np.square(x[:, None] - others_x) + np.square(y[:, None] - others_y)) / 2)


def local_losses(histograms: np.ndarray, positions: np.ndarray, sigma: float) -> np.ndarray:
    """``(N,)``: the loss of each sample, (1/N) sum_j CS(h_i, h_j) - d_e(pos_i, pos_j).

    Their mean is L(D): lower is better. The similarities of a sample add up to one product with
    the sum of all unit histograms.

    Raises
    ------
    MapError
        A histogram is all zero, or not finite.
    """
    units = _units(histograms)
    alike = np.einsum("nk,k->n", units, units.sum(axis=0))
    blocks = np.array_split(positions, -(-len(positions) // _ROWS))
    ideal = [ideal_similarity(block, positions, sigma).sum(axis=1) for block in blocks]
    return (alike - np.concatenate(ideal)) / len(units)


def smooth(
    values: np.ndarray, positions: np.ndarray, places: np.ndarray, sigma: float
) -> np.ndarray:
    """``(M,)``: Gaussian-weighted mean of the samples' `values` around `places` ``(M, 2)``."""
    smoothed = []
    for block in np.array_split(places, len(places) // _ROWS + 1):
        weights = ideal_similarity(block, positions, sigma)
        with np.errstate(invalid="ignore"):
            smoothed.append(np.einsum("mn,n->m", weights, values) / weights.sum(axis=1))
    return np.concatenate(smoothed)


def heat_map(
    values: np.ndarray, positions: np.ndarray, area: tuple[float, float, float, float], sigma: float
) -> np.ndarray:
    """Assign a value to every place of the floor: the samples' values, smoothed with a Gaussian.

    A normalised convolution, taken at the centres of cells of 5 cm or a little less, so that whole
    cells fill the area (x_min, x_max, y_min, y_max); over fields 200 along the longer side.

    Returns
    -------
    (rows, columns) array
        Row 0 lies at the smallest y; NaN farther than `sigma` from every sample.
    """
    from scipy.spatial import cKDTree  # which takes a while to load

    cell = max(_FINEST, (area[1] - area[0]) / _CELLS, (area[3] - area[2]) / _CELLS)
    x, y = _centers(*area[:2], cell), _centers(*area[2:], cell)
    places = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    heat = smooth(values, positions, places, sigma)
    heat[cKDTree(positions).query(places)[0] > sigma] = np.nan
    return heat.reshape(len(y), len(x))


def _centers(start: float, end: float, cell: float) -> np.ndarray:
    count = max(1, int(np.ceil((end - start) / cell - 1e-9)))
    return start + (np.arange(count) + 0.5) * (end - start) / count


def _units(histograms: np.ndarray) -> np.ndarray:
    """The histograms, each divided by its length."""
    histograms = np.asarray(histograms, dtype=float)
    length = np.sqrt(np.einsum("nk,nk->n", histograms, histograms))
    bad = np.flatnonzero(~((length > 0) & np.isfinite(length)))
    if len(bad):
        raise MapError(
            f"{len(bad)} of {len(histograms)} histograms are zero or not finite, row {bad[0]} the "
            "first: they have no direction to compare, leave these frames out"
        )
    return histograms / length[:, None]
