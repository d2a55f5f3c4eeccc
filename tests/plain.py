"""Plain definitions to compare with: slow, short, and written from the paper alone."""

from __future__ import annotations

import numpy as np


def plain_labels(image: np.ndarray, textons: np.ndarray) -> np.ndarray:
    """``(H - P + 1, W - P + 1)``: the texton with the smallest squared Euclidean distance, the
    first of equals.
    """
    patch = textons.shape[1]
    rows, columns = image.shape[0] - patch + 1, image.shape[1] - patch + 1
    labels = np.empty((rows, columns), dtype=np.int64)
    wide = textons.astype(np.int64)
    for row in range(rows):
        for column in range(columns):
            difference = wide - image[row : row + patch, column : column + patch]
            labels[row, column] = (difference**2).sum(axis=(1, 2, 3)).argmin()
    return labels


def plain_histogram(image: np.ndarray, textons: np.ndarray) -> np.ndarray:
    """``(K,)``: relative frequency of each label."""
    labels = plain_labels(image, textons)
    return np.array([(labels == texton).sum() for texton in range(len(textons))]) / labels.size


def plain_kohonen_steps(
    patches: np.ndarray, textons: np.ndarray, gains: np.ndarray, grain: float
) -> None:
    """The compiled kernel of the same name, in NumPy."""
    chain = np.arange(len(textons))
    for n, patch in enumerate(patches):
        difference = patch - textons
        distances = np.einsum("ij,ij->i", difference, difference)
        winner = distances.argmin()
        gain = gains[n * len(gains) // len(patches), np.abs(chain - winner)]
        moved = np.flatnonzero(gain)
        textons[moved] = (
            np.rint((textons[moved] + gain[moved, None] * difference[moved]) * grain) / grain
        )
