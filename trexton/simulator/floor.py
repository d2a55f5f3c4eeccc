"""The floor of the virtual room. Offers `Floor`: a picture with a place, plain ground around it,
and light; and `LAYOUTS` of painted ones, of which some repeat a print, to mislead a localizer."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np

from trexton.base.errors import ImageError, ParameterError
from trexton.base.options import number
from trexton.simulator.hall import paint_hall
from trexton.simulator.mats import HALL, PIXELS_PER_METRE, Placement
from trexton.vision.camera import MapImage
from trexton.vision.images import read_picture

MARGIN = 1.25  # metres of ground around it: a camera above its edge still sees something
GROUND = (140, 147, 150)  # BGR of bare concrete


@dataclass(frozen=True)
class Light:
    """The hall's light: its brightness (`gain`), the share by which red gains and blue loses
    (`warmth`), and the shares by which it grows from the middle of the floor to its right and to
    its far edge (`gradient`).
    """

    gain: float = 1.0
    warmth: float = 0.0
    gradient: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def later(cls) -> Light:
        """An hour later: the sun has moved on."""
        return cls(gain=0.97, warmth=0.02, gradient=(0.03, -0.02))


@dataclass(frozen=True, eq=False)
class Texture:
    """The lit floor as the renderer needs it.

    Attributes
    ----------
    levels : list of (h, w, 4) uint8 arrays
        Y, Cr, Cb (OpenCV's order) and a fourth, with which OpenCV is twice as fast; each level has
        half the resolution of the one before.
    from_world : (3, 3) array
        Metres to pixels of level 0.
    """

    levels: list[np.ndarray]
    from_world: np.ndarray

    def level(self, pixels_per_metre: float) -> tuple[np.ndarray, np.ndarray]:
        """The level for a camera of this resolution, and the homography from metres to it."""
        wanted = np.log2(PIXELS_PER_METRE / pixels_per_metre)
        number = int(np.clip(np.floor(wanted + 0.25), 0, 5))
        while len(self.levels) <= number:
            self.levels.append(cv2.pyrDown(self.levels[-1]))
        return self.levels[number], np.diag([0.5**number, 0.5**number, 1.0]) @ self.from_world


@dataclass(frozen=True, eq=False)
class Floor:
    """A picture of the floor; where its mask is False, and all around it, lies plain ground."""

    picture: MapImage

    @staticmethod
    @lru_cache(maxsize=2)
    def painted(layout: str = "hall", seed: int = 0) -> Floor:
        """A painted floor of 5 m x 5 m, its mats laid by `layout`; equal seeds, equal floors."""
        if seed < 0:
            raise ParameterError(f"the floor's seed is {seed}: expected 0 or more")
        if layout not in LAYOUTS:
            known = ", ".join(LAYOUTS)
            raise ParameterError(f"layout {layout!r} is unknown: choose one of {known}")
        # Older than named streams; others would lay other floors, and every figure of every record.
        laid, painted = np.random.default_rng([seed, 1]), np.random.default_rng(seed)
        return Floor(paint_hall(painted, LAYOUTS[layout](laid)))

    @classmethod
    def from_file(cls, path: str | os.PathLike[str], width: float) -> Floor:
        """A picture file as a floor `width` metres wide, its lower left corner at the origin.

        Where the picture is transparent (alpha 0) the floor is not mapped.

        Raises
        ------
        ImageError
            The file is no picture, or one of a single colour.
        ParameterError
            A side, `width` or the one that the picture's shape gives, is not 0.5 to 50 m.
        """
        width = number(width, "the floor's width", low=0.5, high=50)
        picture = read_picture(path)
        if picture is None:
            raise ImageError(f"{path}: not a readable picture: give a PNG or JPEG of the floor")
        image, mask = picture
        scale = image.shape[1] / width
        length = number(
            image.shape[0] / scale,
            "the floor's length, by the shape of its picture,", low=0.5, high=50,
        )  # fmt: skip
        if cv2.meanStdDev(image if mask is None else image * mask[..., None])[1].max() < 1:
            raise ImageError(
                f"{path}: shows one colour, or nothing at all: no place on it can be told from "
                "another, give a picture of the floor"
            )
        return cls(MapImage.from_extent(image, 0.0, length, scale, mask))

    @property
    def area(self) -> tuple[float, float, float, float]:
        """x_min, x_max, y_min, y_max of the picture in metres."""
        x, y = np.round(self.picture.corners, 6).T
        return (float(x.min()), float(x.max()), float(y.min()), float(y.max()))

    @lru_cache(maxsize=2)  # noqa: B019  # as of `texture`
    def png(self) -> bytes:
        """The picture as a PNG file, with an alpha channel where parts are not mapped."""
        image = self.picture.image
        if self.picture.mask is not None:
            image = np.dstack([image, np.where(self.picture.mask, 255, 0).astype(np.uint8)])
        return cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 4])[1].tobytes()

    @lru_cache(maxsize=4)  # noqa: B019  # many flights over one floor share what it looks like
    def texture(self, light: Light = Light()) -> Texture:
        """The floor and the ground around it under this light."""
        x_min, x_max, y_min, y_max = self.area
        sides = x_max - x_min, y_max - y_min
        size = [round((side + 2 * MARGIN) * PIXELS_PER_METRE) for side in sides]
        canvas = np.empty((size[1], size[0], 3), np.uint8)
        place = MapImage.from_extent(canvas, x_min - MARGIN, y_max + MARGIN, PIXELS_PER_METRE)
        from_world = np.linalg.inv(place.world_from_pixel)
        inset = round(MARGIN * PIXELS_PER_METRE)
        shift = np.array([[1, 0, -inset], [0, 1, -inset], [0, 0, 1]])
        extent = size[0] - 2 * inset, size[1] - 2 * inset
        drawn = self._drawn(extent, shift @ from_world @ self.picture.world_from_pixel)
        around = inset, inset, inset, inset
        cv2.copyMakeBorder(drawn, *around, cv2.BORDER_CONSTANT, canvas, GROUND)
        _illuminate(canvas, light)
        shown = cv2.cvtColor(canvas, cv2.COLOR_BGR2YCrCb)
        return Texture([cv2.cvtColor(shown, cv2.COLOR_BGR2BGRA)], from_world)

    def _drawn(self, extent: tuple[int, int], drawn_from_pixel: np.ndarray) -> np.ndarray:
        """The picture resampled to so many columns and rows, on the ground."""
        image = self.picture.image
        coarser = 1 / np.sqrt(abs(np.linalg.det(drawn_from_pixel[:2, :2])))
        # The picture is finer than the texture: what cannot be shown is filtered out first.
        if coarser > 1.2:
            image = cv2.GaussianBlur(image, (0, 0), 0.5 * coarser)
        if self.picture.mask is None:
            return cv2.warpPerspective(
                image, drawn_from_pixel, extent, flags=cv2.INTER_CUBIC,
                borderMode=cv2.BORDER_REPLICATE,
            )  # fmt: skip
        mask = self.picture.mask[..., None].astype(np.float32)
        painted = cv2.warpPerspective(image * mask, drawn_from_pixel, extent)
        alpha = cv2.warpPerspective(mask, drawn_from_pixel, extent)[..., None]
        return np.rint(painted + (1 - alpha) * np.array(GROUND, np.uint8)).astype(np.uint8)


def _moved(rng: np.random.Generator) -> tuple[Placement, ...]:
    """The eight mats, each in the place of another."""
    order = rng.permutation(len(HALL))
    return tuple(
        replace(place, mat=HALL[other].mat) for place, other in zip(HALL, order, strict=True)
    )


def _repeats(rng: np.random.Generator) -> tuple[Placement, ...]:
    """Two prints, each laid four times, equal to the pixel."""
    names = rng.choice([place.mat for place in HALL], 2, replace=False)
    return tuple(
        replace(place, mat=str(names[i % 2]), width=1.2, height=1.0, print_seed=int(i % 2))
        for i, place in enumerate(HALL)
    )


def _few(rng: np.random.Generator) -> tuple[Placement, ...]:
    """Two mats on bare boards."""
    return tuple(HALL[i] for i in sorted(rng.choice(len(HALL), 2, replace=False)))


def _carpet(rng: np.random.Generator) -> tuple[Placement, ...]:
    """One print from wall to wall."""
    return (Placement(HALL[int(rng.integers(len(HALL)))].mat, 2.5, 2.5, 4.9, 4.9),)


LAYOUTS: dict[str, Callable[[np.random.Generator], tuple[Placement, ...]]] = {
    "hall": lambda rng: HALL,
    "moved": _moved,
    "repeats": _repeats,
    "few": _few,
    "carpet": _carpet,
}


def _illuminate(canvas: np.ndarray, light: Light) -> None:
    """Multiply by brightness, colour and gradient in place, in strips that spare memory."""
    if light == Light():
        return
    height, width = canvas.shape[:2]
    right = np.linspace(-1, 1, width, dtype=np.float32)
    far = np.linspace(1, -1, height, dtype=np.float32)
    colors = np.array([1 - light.warmth, 1.0, 1 + light.warmth])  # blue, green, red
    gains = (light.gain * colors).astype(np.float32)
    for top in range(0, height, 256):
        strip = canvas[top : top + 256]
        even = 1 + light.gradient[0] * right + light.gradient[1] * far[top : top + 256, None]
        strip[:] = cv2.multiply(strip, even[..., None] * gains, dtype=cv2.CV_8U)
