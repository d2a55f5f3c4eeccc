"""The floor as registration sees it: luma in square cells, north up. Offers `Ground`, which also
says what is mapped."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from trexton.base.errors import MapError
from trexton.vision.camera import Camera, MapImage
from trexton.vision.images import MOST_PIXELS
from trexton.vision.visual_odometry import shrink

__all__ = ["FRAME", "Ground", "fine_cell"]

FRAME = 80  # pixels that a shrunken frame is wide


def fine_cell(camera: Camera, height: float) -> float:
    """Side in metres of the cells of the fine picture: what a pixel of a shrunken frame sees."""
    return height * camera.width / camera.focal / min(FRAME, camera.width)


@dataclass(frozen=True, eq=False)
class Ground:
    """Luma of the floor at one resolution, north up.

    Attributes
    ----------
    luma : (H, W) float32 array
        Grey levels; where nothing is mapped, the mean of what is.
    mask : (H, W) float32 array
        1 where the floor is mapped, 0 elsewhere.
    cell : float
        Side of a cell in metres.
    corner : (2,) array
        x, y of the centre of the top left cell in metres.
    """

    luma: np.ndarray
    mask: np.ndarray
    cell: float
    corner: np.ndarray

    @classmethod
    def from_map(cls, picture: MapImage, cell: float, margin: float = 0.0) -> Ground:
        """Resample a map image to cells of `cell` metres, `margin` metres of unmapped floor around.

        Raises
        ------
        MapError
            Nothing of the picture is mapped, or it is of another order than the cells.
        """
        corners = picture.corners
        low, high = corners.min(axis=0) - margin, corners.max(axis=0) + margin
        sides = np.maximum(np.ceil((high - low) / cell), 1)
        largest = (high - low).max() - 2 * margin
        if not (np.prod(sides) <= MOST_PIXELS and largest > cell):
            raise MapError(
                f"the map image is {largest:.4g} m long where the camera needs cells of "
                f"{cell:.2g} m: check world_from_pixel and the heights, which are in metres, or "
                "cut the picture"
            )
        width, height = (int(count) for count in sides)
        grey = picture.image
        if grey.ndim == 3:
            grey = cv2.cvtColor(grey, cv2.COLOR_BGR2GRAY)
        luma = grey.astype(np.float32)
        mapped = np.ones_like(luma) if picture.mask is None else picture.mask.astype(np.float32)
        corner = np.array([low[0] + cell / 2, high[1] - cell / 2])
        source = _from_world(cell, corner) @ picture.world_from_pixel
        # What a cell averages must be averaged first: a warp alone would alias.
        factor = max(1, round(1 / np.sqrt(abs(np.linalg.det(source[:2, :2])))))
        weighted, mapped = shrink(luma * mapped, factor), shrink(mapped, factor)
        source = source @ np.array(
            [[factor, 0, (factor - 1) / 2], [0, factor, (factor - 1) / 2], [0, 0, 1]]
        )
        weighted = cv2.warpPerspective(weighted, source, (width, height))
        weight = cv2.warpPerspective(mapped, source, (width, height))
        mask = (weight > 0.5).astype(np.float32)
        if not mask.any():
            raise MapError("nothing of the map image is mapped: give one whose mask is not empty")
        filled = np.where(mask > 0, weighted / np.maximum(weight, 1e-6), 0).astype(np.float32)
        filled[mask == 0] = filled[mask > 0].mean()
        return cls(filled, mask, cell, corner)

    @property
    def from_world(self) -> np.ndarray:
        """``(3, 3)`` homography from metres to (column, row)."""
        return _from_world(self.cell, self.corner)

    def near(self, reach: float) -> np.ndarray:
        """``(H, W) bool``: cells that are mapped, or within `reach` metres of one that is."""
        side = 2 * int(np.ceil(reach / self.cell)) + 1
        return cv2.dilate(self.mask, np.ones((side, side), np.uint8)) > 0

    def to_world(self, cells: np.ndarray) -> np.ndarray:
        """``(N, 2)`` (column, row) to metres."""
        return self.corner + self.cell * np.asarray(cells, dtype=float) * (1, -1)

    def to_cells(self, world: np.ndarray) -> np.ndarray:
        """``(N, 2)`` metres to (column, row)."""
        return (np.asarray(world, dtype=float) - self.corner) / self.cell * (1, -1)


def _from_world(cell: float, corner: np.ndarray) -> np.ndarray:
    x, y = corner / cell
    return np.array([[1 / cell, 0, -x], [0, -1 / cell, y], [0, 0, 1.0]])
