"""A pinhole camera that looks down, and images of the floor with a place in the world.

World: x right, y forward, z up, in metres, floor at z = 0. Body axes equal the world's at zero
attitude; attitude is roll (about forward, right side down positive), pitch (about right, nose up
positive) and yaw (about up, counterclockwise positive), in radians, applied as ``Rz(yaw) Rx(pitch)
Ry(roll)``. At zero attitude the image's right is world +x and its top world +y, so a frame looks
like the floor seen from above. Pixel centres have whole coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trexton.base.errors import ParameterError

__all__ = ["Camera", "MapImage", "outline", "rotation_matrix", "transform_points", "wrapped"]


def rotation_matrix(roll: float, pitch: float, yaw: float) -> np.ndarray:
    """``(3, 3)`` rotation that takes body coordinates to world coordinates."""
    (sr, sp, sy), (cr, cp, cy) = np.sin([roll, pitch, yaw]), np.cos([roll, pitch, yaw])
    about_z = np.array([[cy, -sy, 0], [sy, cy, 0], [0, 0, 1]])
    about_x = np.array([[1, 0, 0], [0, cp, -sp], [0, sp, cp]])
    about_y = np.array([[cr, 0, sr], [0, 1, 0], [-sr, 0, cr]])
    return about_z @ about_x @ about_y


def wrapped(angle: ArrayLike) -> np.ndarray:
    """The angles in radians within [-pi, pi)."""
    return np.asarray((np.asarray(angle) + np.pi) % (2 * np.pi) - np.pi)


def transform_points(homography: np.ndarray, points: ArrayLike) -> np.ndarray:
    """Apply a ``(3, 3)`` homography to ``(N, 2)`` points."""
    points = np.asarray(points, dtype=float)
    projected = points @ homography[:, :2].T + homography[:, 2]
    return projected[..., :2] / projected[..., 2:]


def outline(width: int, height: int) -> np.ndarray:
    """``(4, 2)`` outer corners of an image, from the top left one clockwise, in pixels."""
    right, bottom = width - 0.5, height - 0.5
    return np.array([[-0.5, -0.5], [right, -0.5], [right, bottom], [-0.5, bottom]])


@dataclass(frozen=True)
class Camera:
    """Pinhole camera: sizes in pixels; the principal point is the image centre unless given."""

    width: int = 640
    height: int = 480
    focal: float = 520.0
    center: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if not (
            min(self.width, self.height) >= 1
            and 0 < self.focal < np.inf
            and np.isfinite(self.principal_point).all()
        ):
            raise ParameterError(
                f"a camera of {self.width}x{self.height} pixels, focal length {self.focal}, "
                f"principal point {self.principal_point}: expected sizes and a focal length above "
                "0, in pixels"
            )

    @property
    def principal_point(self) -> tuple[float, float]:
        return self.center or ((self.width - 1) / 2, (self.height - 1) / 2)

    def world_from_pixel(self, position: np.ndarray, attitude: np.ndarray) -> np.ndarray:
        """``(3, 3)`` homography from pixels to floor coordinates in metres.

        Parameters
        ----------
        position : (3,) array
            Camera centre in metres, z above the floor.
        attitude : (3,) array
            Roll, pitch, yaw in radians.
        """
        cx, cy = self.principal_point
        f = self.focal
        rays = np.array([[1 / f, 0, -cx / f], [0, -1 / f, cy / f], [0, 0, -1]])
        x, y, z = position
        # A ray R d meets the floor at position + s R d with s = z / -(R d)_z; multiplied out this
        # is linear in d.
        to_floor = np.array([[z, 0, -x], [0, z, -y], [0, 0, -1.0]])
        return to_floor @ rotation_matrix(*attitude) @ rays


@dataclass(frozen=True, eq=False)
class MapImage:
    """An image of the floor and where it lies.

    Attributes
    ----------
    image : (H, W, 3) uint8 array
        BGR.
    world_from_pixel : (3, 3) array
        Homography from pixel (column, row) to metres.
    mask : (H, W) bool array or None
        True where the floor is mapped; None where all of it is.
    """

    image: np.ndarray
    world_from_pixel: np.ndarray
    mask: np.ndarray | None = None

    @classmethod
    def from_extent(
        cls,
        image: np.ndarray,
        x_min: float,
        y_max: float,
        pixels_per_metre: float,
        mask: np.ndarray | None = None,
    ) -> MapImage:
        """A map image that is parallel to the axes, its top left corner at (`x_min`, `y_max`)."""
        step = 1 / pixels_per_metre
        matrix = np.array([[step, 0, x_min + step / 2], [0, -step, y_max - step / 2], [0, 0, 1]])
        return cls(image, matrix, mask)

    @property
    def corners(self) -> np.ndarray:
        """``(4, 2)`` metres, the outer corners of the image."""
        return self.to_world(outline(*self.image.shape[1::-1]))

    def to_world(self, pixels: np.ndarray) -> np.ndarray:
        """``(N, 2)`` pixel coordinates to metres."""
        return transform_points(self.world_from_pixel, pixels)

    def to_pixels(self, world: np.ndarray) -> np.ndarray:
        """``(N, 2)`` metres to pixel coordinates."""
        return transform_points(np.linalg.inv(self.world_from_pixel), world)
