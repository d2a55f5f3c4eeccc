"""A pinhole camera that looks down, images of the floor with a place in the world, and what is done
to a camera's images before a map is learned from them: imports may undistort, crop and scale. The
map remembers it, so that a camera in flight is seen as it was when the map was made.

World: x right, y forward, z up, in metres, floor at z = 0. Body axes equal the world's at zero
attitude; attitude is roll (about forward, right side down positive), pitch (about right, nose up
positive) and yaw (about up, counterclockwise positive), in radians, applied as ``Rz(yaw) Rx(pitch)
Ry(roll)``. At zero attitude the image's right is world +x and its top world +y, so a frame looks
like the floor seen from above. Pixel centres have whole coordinates.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from sys import float_info
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import ArrayLike

from trexton.base.errors import ImageError, ParameterError

BLACK_YUV = (0, 128, 128)
MOST = 2**16  # pixels of a side
COEFFICIENTS = (0, 4, 5, 8, 12, 14)  # so many does OpenCV take
_KEYS = ("source_px", "crop_px", "size_px", "focal_px", "center_px", "distortion")


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
    """Pinhole camera.

    Parameters
    ----------
    width, height : int, pixels
    focal : float, pixels
    center : (x, y), optional
        Principal point in pixels; the image centre unless given.

    Raises
    ------
    ParameterError
        A size or the focal length is not positive, or a number not finite.
    """

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


@dataclass(frozen=True)
class Rectification:
    """What is done to each image: undistorted, cropped, scaled.

    Attributes
    ----------
    source : (width, height)
        Of the images as the camera gives them, in pixels.
    crop : (x, y, width, height)
        What is left of them once they are undistorted.
    size : (width, height)
        To which that is scaled.
    focal : float
        Pixels, of the camera as it is and as it is undistorted to.
    center : (column, row)
        Its principal point.
    distortion : tuple of float
        As OpenCV counts them; empty where nothing is undistorted.

    Raises
    ------
    ParameterError
        A value that cannot be.
    """

    source: tuple[int, int]
    crop: tuple[int, int, int, int]
    size: tuple[int, int]
    focal: float = 1.0
    center: tuple[float, float] = (0.0, 0.0)
    distortion: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        pixels = (*self.source, *self.crop, *self.size)
        lens = (self.focal, *self.center, *self.distortion)
        if (
            (len(self.source), len(self.crop), len(self.size)) != (2, 4, 2)
            or not all(type(n) is int and 0 <= n < MOST for n in pixels)
            or 0 in (*self.source, *self.crop[2:], *self.size)
            or self.crop[0] + self.crop[2] > self.source[0]
            or self.crop[1] + self.crop[3] > self.source[1]
        ):
            raise ParameterError(
                f"images of {self.source} pixels cropped to {self.crop} and scaled to {self.size}: "
                "expected whole pixels, the crop (x, y, width, height) inside the images"
            )
        if (
            not all(isinstance(n, int | float) and abs(n) <= float_info.max for n in lens)
            or self.focal <= 0
            or len(self.center) != 2
            or len(self.distortion) not in COEFFICIENTS
        ):
            raise ParameterError(
                f"a lens of focal length {self.focal}, centre {self.center} and distortion "
                f"{self.distortion}: expected finite numbers, the first above 0, and of the last "
                f"{', '.join(map(str, COEFFICIENTS))}"
            )

    @property
    def changes(self) -> bool:
        """Whether anything is done."""
        return bool(self.distortion) or self.size != self.source

    def apply(self, image: np.ndarray, border: tuple[int, int, int] = BLACK_YUV) -> np.ndarray:
        """The ``(h, w, 3) uint8`` image of a camera's ``(H, W, 3)`` one, in the same colours.

        Parameters
        ----------
        image : (H, W, 3) uint8 array
            Y, U, V, unless `border` says otherwise.
        border : (3,) ints
            What the camera did not see.

        Raises
        ------
        ImageError
            The image is not of the camera's size.
        """
        if image.shape[1::-1] != self.source:
            raise ImageError(
                f"the image is {image.shape[1]}x{image.shape[0]}, the camera gave "
                f"{self.source[0]}x{self.source[1]}: set it to that size"
            )
        if self.distortion:
            image = cv2.remap(image, *self._maps, cv2.INTER_LINEAR, borderValue=border)
        x, y, width, height = self.crop
        image = image[y : y + height, x : x + width]
        if (width, height) != self.size:
            return cv2.resize(image, self.size, interpolation=cv2.INTER_AREA)
        return np.ascontiguousarray(image)

    def camera(self, camera: Camera | None) -> Camera | None:
        """The camera of the images as they come out; None for one of another size.

        Where they are undistorted, it is the one whose distortion is.
        """
        if self.distortion:
            camera = Camera(*self.source, self.focal, self.center)
        if camera is None or (camera.width, camera.height) != self.source:
            return None
        x, y, width, _ = self.crop
        scale = self.size[0] / width
        across, down = camera.principal_point
        center = ((across - x + 0.5) * scale - 0.5, (down - y + 0.5) * scale - 0.5)
        return Camera(*self.size, camera.focal * scale, center)

    @cached_property
    def _maps(self) -> tuple[np.ndarray, np.ndarray]:
        (x, y), f = self.center, self.focal
        matrix = np.array([[f, 0, x], [0, f, y], [0, 0, 1]])
        return cv2.initUndistortRectifyMap(
            matrix, np.array(self.distortion), np.eye(3), matrix, self.source, cv2.CV_32FC1
        )

    def table(self) -> dict[str, Any]:
        """As ``flight.toml`` and maps keep it."""
        pixels = map(list, (self.source, self.crop, self.size))
        lens = float(self.focal), *([*map(float, each)] for each in (self.center, self.distortion))
        return dict(zip(_KEYS, (*pixels, *lens), strict=True))

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Self:
        """What `table` gave; raises `ParameterError` where something is missing, or cannot be."""
        try:
            if set(table) != set(_KEYS):
                raise ValueError("other names")
            values = {name.removesuffix("_px"): value for name, value in table.items()}
            focal = values.pop("focal")
            lists = {name: tuple(value) for name, value in values.items()}
        except (TypeError, ValueError) as error:
            raise ParameterError(
                f"a rectification of {', '.join(table) or 'nothing'} ({error}): expected "
                + ", ".join(_KEYS)
            ) from None
        return cls(focal=focal, **lists)
