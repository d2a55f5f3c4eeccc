"""The floor as registration sees it: luma in square cells, north up. Offers `Ground`, which also
says what is mapped, and `CoarseMatcher`: where on it a frame may lie, by normalised
cross-correlation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np

from trexton.base.errors import MapError
from trexton.base.pictures import MOST_PIXELS
from trexton.vision.camera import Camera, MapImage, transform_points
from trexton.vision.visual_odometry import shrink

_TURN = np.radians(6.0)  # headings closer than half of this share a footprint
_GROWTH = 0.06  # heights closer than half of this share do so, too
_INSET = 0.94  # of the frame: what is left inside it under a few degrees of tilt
_BAND, _SOFT = 9.0, 0.6  # cells: a change slower than the one, faster than the other, is left out
_FEWEST = 0.25  # of a footprint that must lie on the map
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
    cell : float, metres
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


class CoarseMatcher:
    """Correlates the footprint of a frame with the whole floor or a part of it.

    Each place is compared by the pixels that are both in the frame and on the map (Padfield,
    "Masked object registration in the Fourier domain", 2012). What depends on the map and on the
    footprint's shape alone is kept for each heading and height that comes by.

    The `ground` has a margin of half a footprint around what is mapped; the `camera` is that of the
    shrunken frames that `response` takes.
    """

    def __init__(self, ground: Ground, camera: Camera):
        self.ground, self.camera = ground, camera
        self._mask = ground.mask
        self._luma = _band(ground.luma, ground.mask, 1.0)
        self._squared = self._luma**2
        self._footprints: dict[tuple[int, int], tuple[np.ndarray, ...]] = {}

    def response(
        self, frame: np.ndarray, pose: np.ndarray, window: tuple[slice, slice] | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """Correlation of a frame, its image centre on each cell of `window` (rows, columns).

        Parameters
        ----------
        frame : (h, w) uint8 array
            Luma as the shrunken camera takes it.
        pose : (6,) array
            x, y (of no effect), height, roll, pitch, yaw.
        window : pair of slices, optional
            All cells unless given.

        Returns
        -------
        correlation, overlap : (rows, columns) float32 arrays
            -1 to 1, and the share of the footprint that is mapped there; the correlation is 0 where
            that is less than a quarter.
        """
        window = window or (slice(0, self._mask.shape[0]), slice(0, self._mask.shape[1]))
        shape, count, total, squares = self._footprint(pose[2], pose[5])
        half = shape.shape[0] // 2
        world = self.camera.world_from_pixel(np.array([0.0, 0.0, pose[2]]), pose[3:])
        center = transform_points(world, [self.camera.principal_point])[0]
        cell = self.ground.cell
        x, y = half - center[0] / cell, half + center[1] / cell
        place = np.array([[1 / cell, 0, x], [0, -1 / cell, y], [0, 0, 1]])
        banded = _band(frame.astype(np.float32), None, cell * self.camera.focal / pose[2])
        template = cv2.warpPerspective(
            banded, place @ world, shape.shape[::-1], borderMode=cv2.BORDER_REPLICATE
        )
        template = (template - template[shape > 0].mean()) * shape
        rows, columns = (slice(each.start, each.stop + 2 * half) for each in window)

        def padded(image: np.ndarray) -> np.ndarray:
            border = cv2.copyMakeBorder(image, half, half, half, half, cv2.BORDER_CONSTANT)
            return np.ascontiguousarray(border[rows, columns])

        n, map_sum, map_squares = count[window], total[window], squares[window]
        crossed = cv2.matchTemplate(padded(self._luma), template, cv2.TM_CCORR)
        mask = padded(self._mask)
        own_sum: Any = template.sum()
        own_squares: Any = (template**2).sum()
        if not mask.all():
            own_sum = cv2.matchTemplate(mask, template, cv2.TM_CCORR)
            own_squares = cv2.matchTemplate(mask, template**2, cv2.TM_CCORR)
        safe = np.maximum(n, 1)
        shared = crossed - map_sum * own_sum / safe
        map_variance = np.maximum(map_squares - map_sum**2 / safe, safe)
        # A grey level squared a pixel.
        own_variance = np.maximum(own_squares - own_sum**2 / safe, safe)
        overlap = n / shape.sum()
        correlation = shared / np.sqrt(map_variance * own_variance)
        return np.where(overlap < _FEWEST, 0, correlation), overlap

    def _footprint(self, height: float, yaw: float) -> tuple[np.ndarray, ...]:
        """The footprint's shape in cells; the map's count, sum and squares under it, by cell."""
        turn = round(yaw % (2 * np.pi) / _TURN) % round(2 * np.pi / _TURN)
        key = turn, round(np.log(height) / _GROWTH)
        if key not in self._footprints:
            scale = np.exp(key[1] * _GROWTH) / self.camera.focal / self.ground.cell
            extent = _INSET * scale * np.array([self.camera.width, self.camera.height])
            half = int(np.ceil(np.hypot(*extent) / 2))
            x, y = np.meshgrid(*[np.arange(-half, half + 1)] * 2)
            sine, cosine = np.sin(key[0] * _TURN), np.cos(key[0] * _TURN)
            right, up = cosine * x - sine * y, sine * x + cosine * y  # rows count downwards
            shape = ((abs(right) <= extent[0] / 2) & (abs(up) <= extent[1] / 2)).astype(np.float32)
            under = [
                cv2.filter2D(each, -1, shape, borderType=cv2.BORDER_CONSTANT)
                for each in (self._mask, self._luma, self._squared)
            ]
            self._footprints[key] = shape, *under
        return self._footprints[key]


def _band(image: np.ndarray, mask: np.ndarray | None, cell: float) -> np.ndarray:
    """What of an image lies between a cell of `cell` pixels and `_BAND` cells; 0 where the mask is.

    Slower changes are the light's as often as the floor's, faster ones fall between the cells.
    """
    size = (2 * round(_BAND * cell / 2) + 1,) * 2
    if mask is None:
        return cv2.GaussianBlur(image - cv2.blur(image, size), (0, 0), _SOFT * cell)
    slow = cv2.blur(image * mask, size) / np.maximum(cv2.blur(mask, size), 1e-3)
    soft = cv2.GaussianBlur((image - slow) * mask, (0, 0), _SOFT * cell)
    return soft * mask
