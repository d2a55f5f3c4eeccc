"""Texton histograms of an image (Methods, "Histogram Extraction"): of every patch, or of a random
sample.

Every patch gets the label of its nearest texton; a histogram is the relative frequency of each
label. Labels are decided on integers, so that any backend and number of threads give the same bits.
An image is ``(H, W, 3) uint8`` (Y, U, V).

Full sampling runs in a compiled kernel (`trexton.vision.kernels.label_rows`), or as matrix products
where numba is absent. A few hundred samples stay with NumPy: there numba would gain less than it
costs to load.
"""

from __future__ import annotations

import numpy as np

from trexton.base.defaults import SAMPLES
from trexton.base.options import whole
from trexton.vision.images import check_image
from trexton.vision.kernels.load import compiled, in_strips
from trexton.vision.patches import gather_patches, position_grid, sample_positions
from trexton.vision.textons import TextonDictionary

__all__ = ["texton_histogram", "sampled_histogram", "label_image", "sample_positions"]

# Positions labelled at once by matrix products: their scores stay in the processor's cache, and
# BLAS libraries have quicker kernels for matrices this small.
_ROWS, _COLUMNS = 24, 320


def texton_histogram(
    image: np.ndarray,
    dictionary: TextonDictionary,
    backend: str | None = None,
    threads: int | None = None,
    cells: int = 1,
) -> np.ndarray:
    """Relative frequency of each texton over every position: full sampling (301 625 at 640x480 and
    6x6).

    Parameters
    ----------
    image : (H, W, 3) uint8 array
    dictionary : TextonDictionary
    backend : {"numba", "numpy"} or None
        None takes numba where it is installed; both give the same bits.
    threads : int or None
        None takes ``$OMP_NUM_THREADS``, else every processor; any number gives the same bits.
    cells : int
        Cut the image into cells x cells parts and count in each: a spatial histogram (Lazebnik,
        Schmid & Ponce, "Beyond bags of features", 2006). The frequencies of all parts sum to one.

    Returns
    -------
    (K cells^2,) float64 array
        Part after part, in reading order.

    Raises
    ------
    ImageError
        Not an image, or smaller than a patch.
    ParameterError
        `cells` is no whole number of at least 1.
    """
    cells = whole(cells, "cells")
    labels, counts = _label(image, dictionary, backend, threads)
    if cells == 1:
        return counts / labels.size
    rows, columns = (np.arange(length) * cells // length for length in labels.shape)
    return _by_cell(labels, rows[:, None] * cells + columns, dictionary.n_textons, cells)


def label_image(
    image: np.ndarray,
    dictionary: TextonDictionary,
    backend: str | None = None,
    threads: int | None = None,
) -> np.ndarray:
    """``(H - P + 1, W - P + 1) uint8``: the nearest texton at every position; ties go to the lowest
    index.

    Parameters and errors are those of `texton_histogram`.
    """
    return _label(image, dictionary, backend, threads)[0]


def sampled_histogram(
    image: np.ndarray,
    dictionary: TextonDictionary,
    n: int = SAMPLES,
    *,
    rng: np.random.Generator,
    cells: int = 1,
) -> np.ndarray:
    """Relative frequency of each texton over `n` random positions, drawn with replacement.

    Parameters
    ----------
    image : (H, W, 3) uint8 array
        Not copied if contiguous.
    dictionary : TextonDictionary
    n : int
        Number of samples; the error falls as 1 / sqrt(n).
    rng : numpy.random.Generator
    cells : int
        See `texton_histogram`.

    Returns
    -------
    (K cells^2,) float64 array

    Raises
    ------
    ImageError
        Not an image, or smaller than a patch.
    ParameterError
        `n` or `cells` is no whole number of at least 1, or `rng` is no generator.
    """
    cells = whole(cells, "cells")
    positions = sample_positions(check_image(image).shape, dictionary.patch, n, rng)
    labels = dictionary.label(gather_patches(image, positions, dictionary.patch))
    if cells == 1:
        return np.bincount(labels, minlength=dictionary.n_textons) / n
    row, column = (positions * cells // position_grid(image.shape, dictionary.patch)).T
    return _by_cell(labels, row * cells + column, dictionary.n_textons, cells)


def _by_cell(labels: np.ndarray, cell: np.ndarray, n_textons: int, cells: int) -> np.ndarray:
    """``(K cells^2,)`` frequencies of labels that lie in the cells of these numbers."""
    both = cell.astype(np.int64) * n_textons + labels
    return np.bincount(both.ravel(), minlength=n_textons * cells**2) / labels.size


def _label(
    image: np.ndarray, dictionary: TextonDictionary, backend: str | None, threads: int | None
) -> tuple[np.ndarray, np.ndarray]:
    """Labels of all positions, and how often each occurs."""
    kernels = compiled("label_rows", backend)
    labels = np.empty(position_grid(check_image(image).shape, dictionary.patch), dtype=np.uint8)
    flat = np.ascontiguousarray(image).reshape(len(image), -1)

    def work(rows: slice) -> np.ndarray:
        strip = flat[rows.start : rows.stop + dictionary.patch - 1]
        if kernels is None:
            _label_by_products(strip, dictionary, labels[rows])
            return np.bincount(labels[rows].ravel(), minlength=dictionary.n_textons)
        counts = np.zeros(dictionary.n_textons, dtype=np.int64)
        kernels.label_rows(strip, dictionary.words, dictionary.words_bias, labels[rows], counts)
        return counts

    return labels, np.sum(in_strips(work, len(labels), threads), axis=0)


def _label_by_products(image: np.ndarray, dictionary: TextonDictionary, labels: np.ndarray) -> None:
    """Label a strip ``(H, 3 W)`` by matrix products, in blocks of one size (the last ones overlap).

    A block is copied once so that each of its rows holds its P shifted copies, and ones for the
    constant -|t|^2. P such rows in sequence are the matrix of all patches of one row of positions,
    without a further copy.
    """
    patch, n_textons, kind = dictionary.patch, dictionary.n_textons, dictionary.weights.dtype
    height, width = min(_ROWS, labels.shape[0]), min(_COLUMNS, labels.shape[1])
    lines = 3 * patch + 1
    weights = np.zeros((patch, lines, n_textons), dtype=kind)
    weights[:, :-1] = dictionary.weights.reshape(patch, -1, n_textons)
    weights[0, -1] = dictionary.bias
    weights = weights.reshape(-1, n_textons).T
    planar = np.empty((height + patch - 1, 3, width + patch - 1), dtype=np.uint8)
    shifted = np.ones((height + patch - 1, lines, width), dtype=kind)
    shape = (height, patch * lines, width)
    patches = np.lib.stride_tricks.as_strided(shifted, shape, shifted.strides, writeable=False)
    # Texton after texton, so that comparing them runs over long stretches of memory.
    scores, best = (
        np.empty((n_textons, height, width), dtype=kind),
        np.empty((height, width), dtype=kind),
    )
    is_best, ranked = (np.empty(scores.shape, dtype=np.uint8) for _ in range(2))
    rank = np.empty(scores.shape, dtype=np.uint8)
    rank[...] = np.arange(n_textons - 1, -1, -1, dtype=np.uint8)[:, None, None]
    image = image.reshape(len(image), -1, 3)
    for top in _starts(labels.shape[0], height):
        for left in _starts(labels.shape[1], width):
            planar[...] = image[top : top + len(planar), left : left + planar.shape[2]].transpose(
                0, 2, 1
            )
            for dx in range(patch):
                shifted[:, 3 * dx : 3 * dx + 3] = planar[:, :, dx : dx + width]
            np.matmul(weights, patches, out=scores.transpose(1, 0, 2))
            np.equal(scores, np.max(scores, axis=0, out=best), out=is_best.view(bool))
            # The first of the best textons has the highest rank.
            np.multiply(is_best, rank, out=ranked)
            labels[top : top + height, left : left + width] = n_textons - 1 - ranked.max(axis=0)


def _starts(length: int, step: int) -> list[int]:
    """Starts of blocks of `step` that cover `length`, the last moved back to end with it."""
    return [min(start, length - step) for start in range(0, length, step)]
