"""Patches of an image: where they can lie, drawing positions, cutting them out.

A position is the (row, column) of a patch's top left corner; an image is ``(H, W, 3) uint8`` (Y, U,
V), P the patch size.
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from trexton.base.errors import ImageError
from trexton.base.options import whole
from trexton.base.streams import generator
from trexton.vision.images import check_image

__all__ = ["position_grid", "sample_positions", "gather_patches", "draw_patches"]

MOST_SAMPLES = 1_000_000  # three times all patches of 640x480: more only fill the memory


def position_grid(shape: tuple[int, ...], patch: int) -> tuple[int, int]:
    """How many rows and columns of positions an image of `shape` has: (H - P + 1, W - P + 1).

    Raises
    ------
    ImageError
        The image is smaller than a patch.
    """
    rows, columns = shape[0] - patch + 1, shape[1] - patch + 1
    if rows < 1 or columns < 1:
        raise ImageError(
            f"the image has {shape[1]}x{shape[0]} pixels, a patch {patch}x{patch}: give a larger "
            "image"
        )
    return rows, columns


def sample_positions(
    shape: tuple[int, ...], patch: int, n: int, rng: np.random.Generator
) -> np.ndarray:
    """``(n, 2) int64``: random positions, uniform over an image of `shape`, with replacement."""
    rows, columns = position_grid(shape, patch)
    n, rng = whole(n, "the number of samples", 1, MOST_SAMPLES), generator(rng)
    positions = np.empty((2, n), dtype=np.int64)
    np.divmod(rng.integers(rows * columns, size=n), columns, out=(positions[0], positions[1]))
    return positions.T


def gather_patches(image: np.ndarray, positions: np.ndarray, patch: int) -> np.ndarray:
    """``(N, P, P, 3) uint8``: the patches at `positions` ``(N, 2)``; the image is not copied."""
    rows, columns = position_grid(check_image(image).shape, patch)
    image = np.ascontiguousarray(image)
    # One item is a whole row of a patch, 3 P neighbouring bytes.
    line = image.strides[0]
    windows = np.ndarray((rows, columns, patch), f"V{3 * patch}", image, strides=(line, 3, line))
    return windows[positions[:, 0], positions[:, 1]].view(np.uint8).reshape(-1, patch, patch, 3)


def draw_patches(
    images: Iterable[np.ndarray], patch: int, per_image: int, rng: np.random.Generator
) -> np.ndarray:
    """``(N, P, P, 3) uint8``: `per_image` random patches, with replacement, from each image."""
    drawn = [
        gather_patches(image, sample_positions(image.shape, patch, per_image, rng), patch)
        for image in images
    ]
    return np.concatenate(drawn) if drawn else np.empty((0, patch, patch, 3), np.uint8)
