"""Many frames in known places become one picture. Offers `blend`, a mean that favours the middle of
sharp frames."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from trexton.base.errors import MapError
from trexton.base.progress import progress
from trexton.flights.flight import Flight
from trexton.registration.poses import world_from_pixel
from trexton.vision.camera import Camera, MapImage, transform_points
from trexton.vision.images import bgr_from_yuv
from trexton.vision.threads import ahead

__all__ = ["blend"]

_LARGEST = 100_000_000  # pixels


def blend(
    flight: Flight, poses: np.ndarray, used: np.ndarray, camera: Camera, pixels_per_metre: float
) -> MapImage:
    """The map image of the `used` frames, ``(N,) bool``, each placed by its ``(8,)`` pose."""
    rows = np.flatnonzero(used)
    matrices = [world_from_pixel(poses[row], camera) for row in rows]
    width, height = camera.width - 1, camera.height - 1
    corners = [[0, 0], [width, 0], [width, height], [0, height]]
    outlines = [transform_points(matrix, corners) for matrix in matrices]
    (x_min, y_min), (x_max, y_max) = np.min(outlines, axis=(0, 1)), np.max(outlines, axis=(0, 1))
    columns = int(np.ceil((x_max - x_min) * pixels_per_metre))
    lines = int(np.ceil((y_max - y_min) * pixels_per_metre))
    if columns * lines > _LARGEST:
        raise MapError(
            f"the mosaic would have {columns} x {lines} pixels, at most {_LARGEST:.0e} are made: "
            "give fewer frames or more anchors"
        )
    empty = MapImage.from_extent(
        np.zeros((lines, columns, 3), np.uint8), x_min, y_max, pixels_per_metre
    )
    map_from_world = np.linalg.inv(empty.world_from_pixel)
    feather = _feather(camera)

    def place(
        job: tuple[Any, np.ndarray, np.ndarray],
    ) -> tuple[tuple[int, int], tuple[int, int], np.ndarray, np.ndarray]:
        row, matrix, outline = job
        corner, size = _window(transform_points(map_from_world, outline), (columns, lines))
        shift = np.array([[1, 0, -corner[0]], [0, 1, -corner[1]], [0, 0, 1]])
        local, image = shift @ map_from_world @ matrix, flight.image(row)
        sharp = feather * _sharpness(image)
        weight = cv2.warpPerspective(sharp, local, size, flags=cv2.INTER_LINEAR)
        return corner, size, cv2.warpPerspective(image, local, size, flags=cv2.INTER_LINEAR), weight

    total = np.zeros((lines, columns, 3), np.float32)
    weights = np.zeros((lines, columns), np.float32)
    placed = ahead(place, zip(rows, matrices, outlines, strict=True))
    for corner, size, image, weight in progress(placed, "blending", len(rows)):
        down, across = (slice(corner[i], corner[i] + size[i]) for i in (1, 0))
        window = down, across
        total[window] += image * weight[..., None]
        weights[window] += weight
    mask = weights > 0
    total[mask] /= weights[mask, None]
    picture = bgr_from_yuv(np.clip(np.rint(total), 0, 255).astype(np.uint8))
    picture[~mask] = 0
    return MapImage(picture, empty.world_from_pixel, mask)


def _feather(camera: Camera) -> np.ndarray:
    """``(H, W) float32`` weights: 1 in the middle, falling steeply to 0 at the border."""
    across = 1 - np.abs(np.linspace(-1, 1, camera.width))
    down = 1 - np.abs(np.linspace(-1, 1, camera.height))
    return (np.outer(down, across) ** 2).astype(np.float32)


def _sharpness(image: np.ndarray) -> np.float32:
    """Mean squared Laplacian of the luma: small in a frame blurred by motion."""
    edges = cv2.Laplacian(image[..., 0], cv2.CV_16S, ksize=1)
    # Never 0: a blank frame counts too.
    return np.float32(np.square(edges, dtype=np.float32).mean() + 1e-3)


def _window(
    outline: np.ndarray, limits: tuple[int, int]
) -> tuple[tuple[int, int], tuple[int, int]]:
    """Corner and size, in whole pixels within `limits`, of the box around an outline."""
    low = np.clip(np.floor(outline.min(axis=0)).astype(int), 0, None)
    high = np.minimum(np.ceil(outline.max(axis=0)).astype(int) + 1, limits)
    return (int(low[0]), int(low[1])), (int(high[0] - low[0]), int(high[1] - low[1]))
