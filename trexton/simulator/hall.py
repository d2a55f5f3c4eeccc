"""The virtual hall: a floor of 5 m x 5 m. Offers `paint_hall`, which paints it from a random
generator alone."""

from collections.abc import Sequence

import cv2
import numpy as np

from trexton.simulator.mats import (
    HALL,
    MATS,
    PIXELS_PER_METRE,
    Placement,
    bgr,
    grain,
    line,
    polygon,
    turning,
)
from trexton.vision.camera import MapImage, outline

SIDE = 5.0
LANDING_CIRCLE = (2.5, 2.42, 0.42)  # x, y, radius in metres


def paint_hall(rng: np.random.Generator, placements: Sequence[Placement] = HALL) -> MapImage:
    """Paint boards, mats, tags, tape, a landing circle, lost things, all by the generator."""
    hall = _Hall(rng, placements)
    hall.lay_boards()
    hall.mark_lanes()
    hall.lay_mats()
    hall.mark_landing_circle()
    hall.stick_tags()
    hall.scatter_objects()
    # Ink spreads and edges are soft, which also prevents aliasing.
    picture = cv2.GaussianBlur(hall.picture, (0, 0), 0.6)
    return MapImage.from_extent(picture, 0.0, SIDE, PIXELS_PER_METRE)


Pair = np.ndarray | tuple[float | np.floating, float | np.floating]  # x and y in metres


class _Hall:
    """The floor while it is being painted; coordinates in metres."""

    def __init__(self, rng: np.random.Generator, placements: Sequence[Placement]):
        self.rng, self.placements = rng, placements
        self.size = round(SIDE * PIXELS_PER_METRE)
        self.map = MapImage.from_extent(
            np.zeros((self.size, self.size, 3), np.uint8), 0.0, SIDE, PIXELS_PER_METRE
        )
        self.picture = self.map.image
        self.taken = np.zeros((self.size, self.size), np.uint8)

    def lay_boards(self) -> None:
        """Oak boards, each with its tone and its grain."""
        board, length = round(0.19 * PIXELS_PER_METRE), round(1.3 * PIXELS_PER_METRE)
        tone = np.zeros((self.size, self.size), np.float32)
        fibre = grain((self.size, self.size), self.rng, (2.0, 5.0, 12.0), stretch=22)
        for top in range(0, self.size, board):
            start = int(self.rng.integers(-length, 0))
            for left in range(start, self.size, length):
                tone[top : top + board, max(left, 0) : left + length] = self.rng.normal(0, 1)
                tone[top : top + board, max(left, 0) : max(left, 0) + 3] = -4.5
            tone[top : top + 3] = -4.5
        speckle = grain((self.size, self.size), self.rng, (1.0, 2.5))
        light = (1 + 0.055 * tone + 0.06 * fibre + 0.02 * speckle)[..., None]
        warm = bgr("c79a6b")[0] * light + (fibre * 3)[..., None] * np.array([-1, 0, 1], np.float32)
        self.picture[:] = np.clip(warm, 0, 255)

    def mark_lanes(self) -> None:
        """Court lines and hazard tape."""
        blue, red, white = bgr("1f5fbf", "c8312b", "f5f3ee")
        for center, size, turn, color in (
            ((2.5, 1.55), (5.0, 0.05), 0.004, white),
            ((1.66, 2.5), (0.05, 5.0), 0.006, blue),
            ((3.46, 2.5), (0.05, 5.0), -0.005, red),
            ((2.5, 3.42), (5.0, 0.05), -0.003, white),
        ):
            polygon(self.picture, self._rectangle(center, size, turn), color)
        for start, end in (((1.72, 3.30), (3.40, 3.36)), ((1.74, 1.70), (3.38, 1.66))):
            self._hazard_tape(np.array(start), np.array(end))

    def lay_mats(self) -> None:
        """The printed mats, a little askew, each with the shadow of its thickness."""
        for place in self.placements:
            size = (round(place.height * PIXELS_PER_METRE), round(place.width * PIXELS_PER_METRE))
            seed = place.print_seed
            rng = self.rng if seed is None else np.random.default_rng(seed)
            self._lay(MATS[place.mat](size, rng), (place.x, place.y), self.rng.normal(0, 0.035))

    def mark_landing_circle(self) -> None:
        """A target in the middle of the hall."""
        x, y, radius = LANDING_CIRCLE
        for reach, color in zip(
            (1.0, 0.93, 0.62, 0.55), bgr("f8f9fa", "1d3557", "f8f9fa", "d62828"), strict=False
        ):
            self._disc((x, y), radius * reach, color)
        white = bgr("f8f9fa")[0]
        for dx, size in ((-0.105, (0.05, 0.27)), (0.105, (0.05, 0.27)), (0, (0.2, 0.05))):
            polygon(self.picture, self._rectangle((x + dx, y), size, 0.0), white)
        pixel = self.map.to_pixels(np.array([[x, y]]))[0].round().astype(int).tolist()
        cv2.circle(self.taken, pixel, round((radius + 0.05) * PIXELS_PER_METRE), 1, -1)

    def stick_tags(self) -> None:
        """Fiducial tags on white cards wherever the boards are free."""
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_250)
        card, number = 0.15, 0
        for x in np.arange(0.16, SIDE, 0.335):
            for y in np.arange(0.16, SIDE, 0.335):
                place = np.array([x, y]) + self.rng.normal(0, 0.02, 2)
                corners = self._rectangle(place, (card, card), self.rng.normal(0, 0.08))
                pixels = corners.round().astype(np.int32)
                low, high = np.maximum(pixels.min(axis=0), 0), pixels.max(axis=0) + 1
                taken = self.taken[low[1] : high[1], low[0] : high[0]]
                footprint = np.zeros_like(taken)
                cv2.fillConvexPoly(footprint, pixels - low, 1)
                if (taken & footprint).any():
                    continue
                tag = cv2.aruco.generateImageMarker(dictionary, number % 250, 48)
                picture = cv2.copyMakeBorder(tag, 12, 12, 12, 12, cv2.BORDER_CONSTANT, value=245)
                self._paste(cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR), corners)
                taken |= footprint
                number += 1

    def scatter_objects(self) -> None:
        """Tubes, cables, balls and boxes, with shadows."""
        orange, black, steel, green = bgr("ff5a1f", "23232b", "aab2bd", "3aa655")
        for start, end, width, color in (
            ((1.55, 0.30), (1.98, 1.38), 0.095, orange),
            ((3.30, 3.05), (4.02, 2.92), 0.085, orange),
            ((1.50, 4.78), (2.02, 4.55), 0.06, steel),
            ((3.52, 0.22), (3.60, 1.30), 0.045, steel),
            ((0.25, 3.27), (0.95, 3.19), 0.055, green),
            ((3.08, 2.05), (3.18, 2.75), 0.04, black),
        ):
            self._tube(np.array(start), np.array(end), width, color)
        for center, radius, color in (
            ((2.05, 3.06), 0.11, bgr("ffd60a")[0]),
            ((3.22, 1.84), 0.085, bgr("e5383b")[0]),
            ((1.93, 1.92), 0.06, bgr("4cc9f0")[0]),
        ):
            self._ball(np.array(center), radius, color)
        for _ in range(3):
            self._cable(self.rng.uniform(0.6, 4.4, 2))
        for center, size, code in (
            ((3.02, 3.08), (0.26, 0.18), "6d4c41"),
            ((1.82, 2.52), (0.17, 0.22), "2b2d42"),
            ((4.78, 1.40), (0.24, 0.16), "f1c453"),
        ):
            self._box(center, size, bgr(code)[0])

    # -- brushes -----------------------------------------------------------------------------------

    def _rectangle(self, center: Pair, size: Pair, turn: float) -> np.ndarray:
        """``(4, 2)`` pixel corners: top left, top right, bottom right, bottom left."""
        corners = np.array([[-0.5, 0.5], [0.5, 0.5], [0.5, -0.5], [-0.5, -0.5]]) * size
        return self.map.to_pixels(corners @ turning(turn) + center)

    def _circle(self, center: Pair, radius: float, count: int) -> np.ndarray:
        """``(count, 2)`` pixels on a circle."""
        angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
        on_circle = radius * np.column_stack([np.cos(angle), np.sin(angle)])
        return self.map.to_pixels(np.asarray(center) + on_circle)

    def _disc(self, center: Pair, radius: float, color: np.ndarray) -> None:
        polygon(self.picture, self._circle(center, radius, 90), color)

    def _paste(self, picture: np.ndarray, corners: np.ndarray) -> None:
        """Warp `picture` onto the quadrilateral `corners`, touching only its bounding box."""
        low = np.maximum(np.floor(corners.min(axis=0)).astype(int) - 2, 0)
        high = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 3, self.size)
        height, width = picture.shape[:2]
        source = outline(width, height).astype(np.float32)
        matrix = cv2.getPerspectiveTransform(source, (corners - low).astype(np.float32))
        extent = tuple((high - low).tolist())
        alpha = cv2.warpPerspective(np.ones((height, width), np.float32), matrix, extent)[..., None]
        warped = cv2.warpPerspective(picture, matrix, extent, borderMode=cv2.BORDER_REPLICATE)
        target = self.picture[low[1] : high[1], low[0] : high[0]]
        target[:] = np.rint(alpha * warped + (1 - alpha) * target)

    def _shade(self, corners: np.ndarray, depth: float, softness: float) -> None:
        """Darken a polygon by the share `depth`, its edge blurred over `softness` pixels."""
        low = np.maximum(np.floor(corners.min(axis=0) - 3 * softness).astype(int), 0)
        high = np.minimum(np.ceil(corners.max(axis=0) + 3 * softness).astype(int), self.size)
        shadow = np.zeros((*(high - low)[::-1],), np.float32)
        cv2.fillPoly(shadow, [(corners - low).round().astype(np.int32)], depth)
        shadow = cv2.GaussianBlur(shadow, (0, 0), softness)[..., None]
        target = self.picture[low[1] : high[1], low[0] : high[0]]
        target[:] = np.rint(target * (1 - shadow))

    def _lay(self, picture: np.ndarray, center: Pair, turn: float) -> None:
        size = np.array(picture.shape[1::-1]) / PIXELS_PER_METRE
        corners = self._rectangle(center, size, turn)
        self._shade(corners + 5, 0.45, 6)
        self._paste(picture, corners)
        around = self._rectangle(center, size + 0.03, turn)
        cv2.fillConvexPoly(self.taken, around.round().astype(np.int32), 1)

    def _hazard_tape(self, start: np.ndarray, end: np.ndarray) -> None:
        length = round(np.linalg.norm(end - start) * PIXELS_PER_METRE)
        y, x = np.mgrid[:27, :length]
        tape = bgr("ffc300", "1c1c1c")[((x + y) // 34) % 2].astype(np.uint8)
        turn = np.arctan2(*(end - start)[::-1])
        size = np.array([length, 27]) / PIXELS_PER_METRE
        self._paste(tape, self._rectangle((start + end) / 2, size, turn))

    def _tube(self, start: np.ndarray, end: np.ndarray, width: float, color: np.ndarray) -> None:
        length = np.linalg.norm(end - start)
        turn = np.arctan2(*(end - start)[::-1])
        rows, columns = round(width * PIXELS_PER_METRE), round(length * PIXELS_PER_METRE)
        across = np.linspace(-1, 1, rows)[:, None, None]
        gloss = 0.35 * np.exp(-(((across + 0.35) / 0.16) ** 2))
        shine = 0.45 + 0.55 * np.sqrt(1 - 0.9 * across**2) + gloss
        tube = np.clip(color * shine * np.ones((1, columns, 1)), 0, 255)
        cap = max(3, columns // 9)
        tube[:, :cap] *= 0.25
        corners = self._rectangle((start + end) / 2, (length, width), turn)
        self._shade(corners + 12, 0.5, 9)
        self._paste(tube.astype(np.uint8), corners)

    def _ball(self, center: np.ndarray, radius: float, color: np.ndarray) -> None:
        self._shade(self._circle(center, radius, 40) + 14, 0.5, 12)
        for reach, shift, light in (
            (1.0, 0.0, 0.72),
            (0.9, 0.05, 0.88),
            (0.72, 0.12, 1.0),
            (0.25, 0.3, 1.35),
        ):
            offset = np.array([-shift, shift]) * radius
            lit = np.clip(color * light + (60 if light > 1 else 0), 0, 255)
            self._disc(center + offset, radius * reach, lit)

    def _cable(self, start: np.ndarray) -> None:
        steps = np.cumsum(self.rng.normal(0, 0.16, 70))
        path = start + np.cumsum(0.022 * np.column_stack([np.cos(steps), np.sin(steps)]), axis=0)
        pixels = self.map.to_pixels(path)
        for shift, thickness, color in ((5, 9, "6b4a2e"), (0, 8, "23232b"), (-1, 2, "6c757d")):
            line(self.picture, pixels + shift, bgr(color)[0], thickness)

    def _box(self, center: Pair, size: Pair, color: np.ndarray) -> None:
        turn = self.rng.uniform(-0.6, 0.6)
        corners = self._rectangle(center, size, turn)
        self._shade(corners + 14, 0.5, 10)
        polygon(self.picture, corners, color * 0.7)
        polygon(self.picture, self._rectangle(center, np.array(size) * 0.9, turn), color)
        flap = self._rectangle(center, (size[0] * 0.9, 0.035), turn)
        polygon(self.picture, flap, color * 0.45 + 120)
