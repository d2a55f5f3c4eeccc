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
