"""From the images that a camera gives to those that a map was learned from.

Imports may undistort, crop and scale. The map remembers it, so that a camera in flight is seen as
it was when the map was made.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from sys import float_info
from typing import Any, Self

import cv2
import numpy as np

from trexton.base.errors import ImageError, ParameterError
from trexton.vision.camera import Camera

__all__ = ["BLACK_YUV", "Rectification"]

BLACK_YUV = (0, 128, 128)
MOST = 2**16  # pixels of a side
COEFFICIENTS = (0, 4, 5, 8, 12, 14)  # so many does OpenCV take
_KEYS = ("source_px", "crop_px", "size_px", "focal_px", "center_px", "distortion")
Size = tuple[int, int]


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

    source: Size
    crop: tuple[int, int, int, int]
    size: Size
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
        return {
            "source_px": list(self.source),
            "crop_px": list(self.crop),
            "size_px": list(self.size),
            "focal_px": float(self.focal),
            "center_px": [float(value) for value in self.center],
            "distortion": [float(value) for value in self.distortion],
        }

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> Self:
        """What `table` gave.

        Raises
        ------
        ParameterError
            Something is missing, or cannot be.
        """
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
