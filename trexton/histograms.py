"""Texton histograms of an image (Methods, "Histogram Extraction"): from every position, or from a random sample.

Every patch gets the label of its nearest texton; a histogram is the relative frequency of each label. Labels are decided
on integers, so that any backend and number of threads give the same bits. An image is ``(H, W, 3) uint8`` (Y, U, V).
"""

from __future__ import annotations

import numpy as np

from trexton.images import check_image
from trexton.kernels import compiled
from trexton.patches import gather_patches, position_grid, sample_positions
from trexton.textons import TextonDictionary

__all__ = ["texton_histogram", "sampled_histogram", "label_image", "sample_positions"]

_ROWS = 32  # rows labelled at once: their scores stay in the processor's cache


def texton_histogram(image: np.ndarray, dictionary: TextonDictionary, backend: str | None = None) -> np.ndarray:
    """Relative frequency of each texton over every position: full sampling (301 625 positions at 640x480 and 6x6).

    Parameters
    ----------
    image : (H, W, 3) uint8 array
    dictionary : TextonDictionary
    backend : {"numba", "numpy"} or None
        None takes numba where it is installed; both give the same bits.

    Returns
    -------
    (K,) float64 array
    """
    labels = label_image(image, dictionary, backend)
    return np.bincount(labels.ravel(), minlength=dictionary.n_textons) / labels.size


def sampled_histogram(image: np.ndarray, dictionary: TextonDictionary, n: int = 400, *, rng: np.random.Generator) -> np.ndarray:
    """Relative frequency of each texton over `n` random positions, drawn with replacement.

    Parameters
    ----------
    image : (H, W, 3) uint8 array
    dictionary : TextonDictionary
    n : int
        Number of samples; the error falls as 1 / sqrt(n).
    rng : numpy.random.Generator

    Returns
    -------
    (K,) float64 array
    """
    positions = sample_positions(image.shape, dictionary.patch, n, rng)
    labels = dictionary.label(gather_patches(image, positions, dictionary.patch))
    return np.bincount(labels, minlength=dictionary.n_textons) / n


def label_image(image: np.ndarray, dictionary: TextonDictionary, backend: str | None = None) -> np.ndarray:
    """``(H - P + 1, W - P + 1) uint8``: the nearest texton at every position; ties go to the lowest index."""
    shape = position_grid(check_image(image).shape, dictionary.patch)
    labels = np.empty(shape, dtype=np.uint8)
    for first in range(0, shape[0], _ROWS):
        _label_rows(image[first : first + _ROWS + dictionary.patch - 1], dictionary, labels[first : first + _ROWS])
    return labels


def _label_rows(image: np.ndarray, dictionary: TextonDictionary, labels: np.ndarray) -> None:
    """Label all positions of a strip of the image by matrix products.

    The strip is copied once so that each row holds its P shifted copies; P rows in sequence are then the matrix of all
    patches of one row of positions, without a further copy.
    """
    patch, (height, width) = dictionary.patch, labels.shape
    shifted = np.empty((len(image), patch, 3, width), dtype=dictionary.weights.dtype)
    for dx in range(patch):
        shifted[:, dx] = image[:, dx : dx + width].transpose(0, 2, 1)
    rows = shifted.reshape(len(image) * patch * 3, width)
    step = patch * 3
    patches = np.lib.stride_tricks.as_strided(
        rows, (height, patch * step, width), (step * rows.strides[0], *rows.strides), writeable=False
    )
    scores = dictionary.weights @ patches
    scores += dictionary.bias[:, None]
    labels[...] = scores.argmax(axis=1)

