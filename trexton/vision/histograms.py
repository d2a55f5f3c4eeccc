"""Texton histograms of an image (Methods, "Histogram Extraction"): of every patch, or of a random
sample.

Every patch gets the label of its nearest texton; a histogram is the relative frequency of each
label. Labels are decided on integers, so that any number of threads gives the same bits. An image
is ``(H, W, 3) uint8`` (Y, U, V).

Full sampling runs in a compiled kernel (`trexton.vision.kernels`). A few hundred samples
stay with NumPy: there numba would gain less than it costs to load.
"""

from __future__ import annotations

import numpy as np

from trexton.base.defaults import SAMPLES
from trexton.base.errors import ParameterError
from trexton.base.options import whole
from trexton.vision.images import check_image, gather_patches, position_grid, sample_positions
from trexton.vision.textons import TextonDictionary
from trexton.vision.threads import in_strips

SUM_TOLERANCE = 0.01  # by which relative frequencies may miss a sum of 1


def texton_histogram(image: np.ndarray, dictionary: TextonDictionary, cells: int = 1) -> np.ndarray:
    """Relative frequency of each texton over every position (301 625 at 640x480): full sampling.

    It runs on as many threads as ``$OMP_NUM_THREADS`` says, else on every processor; any number
    gives the same bits.

    Parameters
    ----------
    image : (H, W, 3) uint8 array
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
    _, counts = label_image(image, dictionary, whole(cells, "cells"))
    return counts / counts.sum()


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
    n : int
        Number of samples; the error falls as 1 / sqrt(n).
    rng : numpy.random.Generator
    cells : int
        See `texton_histogram`.

    Returns
    -------
    (K cells^2,) float64 array
        Part after part, in reading order.

    Raises
    ------
    ImageError, ParameterError
        As `texton_histogram`; also where `n` is less than 1, or `rng` no generator.
    """
    positions = sample_positions(check_image(image).shape, dictionary.patch, n, rng)
    patches = gather_patches(image, positions, dictionary.patch)
    return patch_histogram(patches, positions, image.shape, dictionary, cells)


def patch_histogram(
    patches: np.ndarray,
    positions: np.ndarray,
    shape: tuple[int, ...],
    dictionary: TextonDictionary,
    cells: int = 1,
) -> np.ndarray:
    """``(K cells^2,)`` relative frequencies among ``(N, P, P, 3) uint8`` patches, which lie at
    `positions` ``(N, 2)`` of an image of this shape; errors are those of `sampled_histogram`.
    """
    cells, labels = whole(cells, "cells"), dictionary.label(patches)
    if cells == 1:
        return np.bincount(labels, minlength=dictionary.n_textons) / len(labels)
    row, column = (positions * cells // position_grid(shape, dictionary.patch)).T
    both = (row * cells + column) * dictionary.n_textons + labels
    return np.bincount(both, minlength=dictionary.n_textons * cells**2) / len(labels)


def label_image(
    image: np.ndarray, dictionary: TextonDictionary, cells: int = 1
) -> tuple[np.ndarray, np.ndarray]:
    """``(H - P + 1, W - P + 1) uint8``: the nearest texton at every position, ties to the lowest;
    and how often each occurs in each of the cells. It raises as `texton_histogram` does.
    """
    from numba import config

    from trexton.vision.kernels import label_rows  # numba takes a while to load

    if config.DISABLE_JIT:  # type: ignore[attr-defined]  # numba sets it as it is imported
        raise ParameterError("images are labelled by compiled code: unset NUMBA_DISABLE_JIT")
    labels = np.empty(position_grid(check_image(image).shape, dictionary.patch), dtype=np.uint8)
    flat = np.ascontiguousarray(image).reshape(len(image), -1)
    # Where the counts of a row's and of a column's cell begin.
    down, right = (
        np.arange(length) * cells // length * step * dictionary.n_textons
        for length, step in zip(labels.shape, (cells, 1), strict=True)
    )

    def work(rows: slice) -> np.ndarray:
        strip = flat[rows.start : rows.stop + dictionary.patch - 1]
        counts = np.zeros(dictionary.n_textons * cells**2, dtype=np.int64)
        words = dictionary.words, dictionary.words_bias
        label_rows(strip, *words, labels[rows], counts, down[rows], right)
        return counts

    return labels, np.sum(in_strips(work, len(labels)), axis=0)
