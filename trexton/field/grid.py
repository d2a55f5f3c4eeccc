"""A floor is divided into squares on which densities are held. Offers their centres (`grid_cells`),
values between them (`bilinear`), and where most of a likelihood lies (`peaks`)."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from trexton.localization.base import Area

__all__ = ["bilinear", "grid_cells", "peaks"]

PEAKS, PEAK_MASS = 2, 0.02  # at most; and the share of a likelihood that one must hold


def grid_cells(area: Area, cells: int) -> tuple[np.ndarray, tuple[int, int]]:
    """``(M, 2)`` centres of about `cells` squares, x slowest, and how many along x and y."""
    x_min, x_max, y_min, y_max = area
    side = np.sqrt((x_max - x_min) * (y_max - y_min) / cells)
    most = max(2, cells // 2)  # of a strip: two beside another
    nx, ny = (
        min(max(2, round((high - low) / side)), most)
        for low, high in ((x_min, x_max), (y_min, y_max))
    )
    x = x_min + (np.arange(nx) + 0.5) * (x_max - x_min) / nx
    y = y_min + (np.arange(ny) + 0.5) * (y_max - y_min) / ny
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2), (nx, ny)


def bilinear(grid: np.ndarray, area: np.ndarray, places: np.ndarray) -> np.ndarray:
    """``(M,)`` values of a grid ``(nx, ny)`` over the area, constant beyond its outer centres."""
    places = np.asarray(places, dtype=float)
    count = np.array(grid.shape)
    low, high = area[::2], area[1::2]
    at = np.clip((places - low) / (high - low) * count - 0.5, 0, count - 1)
    first = np.minimum(at.astype(np.int64), count - 2)
    (u, v), (i, j) = (at - first).T, first.T
    result: np.ndarray = (1 - u) * ((1 - v) * grid[i, j] + v * grid[i, j + 1])
    result += u * ((1 - v) * grid[i + 1, j] + v * grid[i + 1, j + 1])
    return result


def peaks(
    cells: np.ndarray, shares: np.ndarray, radius: float
) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
    """Means ``(2,)``, covariances ``(2, 2)`` and shares of the likeliest places, of a likelihood
    `shares` ``(M,)`` over `cells` ``(M, 2)``, each of what lies within `radius` metres.
    """
    left = shares.copy()
    for _ in range(PEAKS):
        best = int(left.argmax())
        near = np.hypot(*(cells - cells[best]).T) < radius
        mass = float(left[near].sum())
        if mass < PEAK_MASS:
            break
        part = left[near] / mass
        left[near] = 0
        mean = part @ cells[near]
        offset = cells[near] - mean
        yield mean, (offset.T * part) @ offset, mass
