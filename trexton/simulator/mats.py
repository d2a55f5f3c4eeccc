"""Printed mats for the virtual hall: each function paints ``(height, width, 3) uint8`` BGR; and how
the mats lie there.

Some repeat a motif, which misleads a localizer that sees only one of them; others never show the
same thing twice. A mat follows from its size and the generator.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike

PIXELS_PER_METRE = 512  # a camera of 520 px focal length at 1 m sees 520 px/m
_SUBPIXEL = 4  # fractional bits of OpenCV's drawing coordinates


def bgr(*codes: str) -> np.ndarray:
    """``(N, 3) float32`` BGR from hexadecimal RGB codes."""
    return np.array([[*bytes.fromhex(code)][::-1] for code in codes], dtype=np.float32)


def grain(
    shape: tuple[int, int],
    rng: np.random.Generator,
    scales: tuple[float, ...],
    stretch: float = 1.0,
) -> np.ndarray:
    """``shape float32`` noise of deviation near 1, a layer a scale in pixels, stretched along x."""
    total = np.zeros(shape, np.float32)
    for scale in scales:
        coarse = (max(2, int(shape[0] / scale) + 1), max(2, int(shape[1] / (scale * stretch)) + 1))
        layer = rng.standard_normal(coarse, dtype=np.float32)
        total += cv2.resize(layer, shape[::-1], interpolation=cv2.INTER_CUBIC)
    return total / np.sqrt(len(scales))


def polygon(image: np.ndarray, points: ArrayLike, color: np.ndarray) -> None:
    """Fill the polygon of ``(N, 2)`` pixel coordinates with smooth edges."""
    fixed = np.round(np.asarray(points) * 2**_SUBPIXEL).astype(np.int32)
    cv2.fillPoly(image, [fixed], color.tolist(), cv2.LINE_AA, _SUBPIXEL)


def turning(turn: float) -> np.ndarray:
    """``(2, 2)``: rows of (x, y) times this are turned by so many radians."""
    return np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])


def _disc(
    image: np.ndarray, center: ArrayLike, radius: float, color: np.ndarray, thickness: int = -1
) -> None:
    fixed = [int(round(value * 2**_SUBPIXEL)) for value in (*np.asarray(center), radius)]
    cv2.circle(image, fixed[:2], fixed[2], color.tolist(), thickness, cv2.LINE_AA, _SUBPIXEL)


def line(
    image: np.ndarray, points: ArrayLike, color: np.ndarray, thickness: int, closed: bool = False
) -> None:
    fixed = np.round(np.asarray(points) * 2**_SUBPIXEL).astype(np.int32)
    cv2.polylines(image, [fixed], closed, color.tolist(), thickness, cv2.LINE_AA, _SUBPIXEL)


def _ring_of(
    center: ArrayLike, radius: float, corners: int, turn: float = 0.0, inner: float = 1.0
) -> np.ndarray:
    """A regular polygon, or a star where `inner` < 1."""
    angle = turn + np.arange(2 * corners) * np.pi / corners
    x, y = np.asarray(center, dtype=float)
    reach = radius * np.where(np.arange(2 * corners) % 2, inner, 1.0)
    return np.column_stack([x + reach * np.cos(angle), y + reach * np.sin(angle)])


def _scatter(size: tuple[int, int], spacing: float, rng: np.random.Generator) -> np.ndarray:
    """``(N, 2)`` pixel positions (x, y) in random order, about `spacing` apart: a shaken grid."""
    rows, columns = np.mgrid[0 : size[0] + spacing : spacing, 0 : size[1] + spacing : spacing]
    shaken = rng.uniform(-0.45, 0.45, (columns.size, 2)) * spacing
    return rng.permutation(np.column_stack([columns.ravel(), rows.ravel()]) + shaken)


def waves(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Wavy stripes of sea and sand; repeats along both axes."""
    colors = bgr("f4e9d2", "2a6f97", "61a5c2", "f4e9d2", "89c2d9", "e9c46a")
    y, x = np.mgrid[: size[0], : size[1]].astype(np.float32)
    phase = y + 13 * np.sin(x / 26) + 5 * np.sin(x / 9 + y / 40)
    return colors[(phase // 21).astype(int) % len(colors)].astype(np.uint8)


def tiles(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Glazed cement tiles with a star in each; repeats along both axes."""
    side = 92
    navy, white, ochre, teal, brick = bgr("1d3557", "f1faee", "e9a23b", "2a9d8f", "c1440e")
    tile = np.full((side, side, 3), white, np.uint8)
    for corner in ((0, 0), (side, 0), (0, side), (side, side)):
        _disc(tile, corner, 36, navy)
        _disc(tile, corner, 25, teal)
        _disc(tile, corner, 12, ochre)
    middle = (side / 2, side / 2)
    polygon(tile, _ring_of(middle, 36, 8, np.pi / 8, 0.55), brick)
    polygon(tile, _ring_of(middle, 17, 4, 0, 0.6), white)
    corners = [[0, 0], [side, 0], [side, side], [0, side]]
    line(tile, corners, bgr("b8b0a2")[0], 2, closed=True)
    repeats = [-(-length // side) for length in size]
    return np.tile(tile, (*repeats, 1))[: size[0], : size[1]].copy()


def rug(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """A knotted rug: a quarter of random ornament, mirrored twice, within a border."""
    height, width = (size[0] + 1) // 2, (size[1] + 1) // 2
    inks = bgr("1b2a49", "e8c07d", "f3e5c3", "38618c", "7a9e7e", "d9622b", "3b0d11")
    quarter = np.full((height, width, 3), bgr("8c1c2b")[0], np.uint8)
    for x, y in _scatter((height, width), 44, rng):
        outer, inner = rng.permutation(len(inks))[:2]
        radius, corners = rng.uniform(10, 24), int(rng.integers(3, 9))
        star = _ring_of((x, y), radius, corners, rng.uniform(0, 3), rng.uniform(0.4, 0.9))
        polygon(quarter, star, inks[outer])
        _disc(quarter, (x, y), radius * 0.4, inks[inner])
    medallion = 0.55 * min(height, width)
    for reach, ink in ((1.0, 1), (0.92, 0), (0.7, 5), (0.55, 2), (0.3, 3), (0.15, 1)):
        polygon(quarter, _ring_of((width, height), medallion * reach, 8, 0, 0.8), inks[ink])
    for depth, ink in ((58, 6), (50, 1), (44, 0)):
        quarter[:depth], quarter[:, :depth] = inks[ink], inks[ink]
    for step in range(22, max(height, width), 40):
        for center in ((step, 22), (22, step)):
            polygon(quarter, _ring_of(center, 16, 4, 0, 0.5), inks[2 if step % 80 < 40 else 5])
    half = np.concatenate([quarter, quarter[:, ::-1]], axis=1)
    whole = np.concatenate([half, half[::-1]], axis=0)[: size[0], : size[1]]
    knots = grain(size, rng, (2.0, 5.0))[..., None] * 9
    return np.clip(whole + knots, 0, 255).astype(np.uint8)


def town(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """A play mat: meadows, ponds, trees, houses and winding roads; never repeats."""
    mat = np.full((*size, 3), bgr("7cb85c")[0], np.uint8)
    meadow = grain(size, rng, (60.0, 140.0))
    mat[meadow > 0.7] = bgr("a3cf62")[0]
    mat[meadow < -1.0] = bgr("4fa3d1")[0]
    roofs = bgr("d1495b", "edae49", "9b5de5", "00798c", "f28482", "ffffff")
    crowns = bgr("2d6a4f", "40916c", "1b4332", "f4845f")
    for x, y in _scatter(size, 62, rng):
        if rng.random() < 0.5:
            for _ in range(3):
                place, radius = (x, y) + rng.normal(0, 9, 2), rng.uniform(8, 15)
                _disc(mat, place, radius, crowns[rng.integers(len(crowns))])
        else:
            _house(mat, (x, y), roofs[rng.integers(len(roofs))], rng)
    for number in range(5):
        along = np.linspace(-0.1, 1.1, 60)
        middle = rng.uniform(0.1, 0.9)
        across = middle + 0.13 * np.sin(along * rng.uniform(4, 9) + rng.uniform(0, 6))
        path = np.column_stack([along, across] if number % 2 else [across, along]) * size[::-1]
        line(mat, path, bgr("f2e9dc")[0], 40)
        line(mat, path, bgr("5c6378")[0], 33)
        for start in range(0, 59, 3):
            line(mat, path[start : start + 2], bgr("fdf6e3")[0], 3)
    return mat


def _house(mat: np.ndarray, center: ArrayLike, roof: np.ndarray, rng: np.random.Generator) -> None:
    half = rng.uniform(11, 22, 2)
    axes = turning(rng.uniform(0, np.pi))
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half @ axes + center
    a, b, c, d = corners
    polygon(mat, corners + 4, bgr("31572c")[0])
    polygon(mat, corners, roof)
    polygon(mat, [a, b, (b + c) / 2, (a + d) / 2], roof * 0.75)
    line(mat, corners, bgr("3d2c2e")[0], 2, closed=True)


def leaves(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Fallen leaves on cream cloth; never repeats."""
    mat = np.full((*size, 3), bgr("f6ead7")[0], np.uint8)
    inks = bgr("bc4749", "e76f51", "f4a261", "6a994e", "386641", "a98467", "e9c46a", "5e3023")
    for x, y in _scatter(size, 50, rng):
        length, width, turn = rng.uniform(17, 34), rng.uniform(0.25, 0.5), rng.uniform(0, 2 * np.pi)
        along = np.linspace(-1, 1, 15)
        side = width * (1 - along**2) * (1 - 0.3 * along)
        upper, lower = np.column_stack([along, side]), np.column_stack([along, -side])
        outline, axes = np.concatenate([upper, lower[::-1]]) * length, turning(turn)
        ink = inks[rng.integers(len(inks))]
        polygon(mat, outline @ axes + (x, y), ink)
        line(mat, np.array([[-1.35 * length, 0], [0.9 * length, 0]]) @ axes + (x, y), ink * 0.6, 2)
    return mat


def bauhaus(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Bold shapes on a dark ground; never repeats."""
    mat = np.full((*size, 3), bgr("22223b")[0], np.uint8)
    inks = bgr("f72585", "ffb703", "00b4d8", "f1faee", "e63946", "80ed99", "fb8500", "7209b7")
    for x, y in _scatter(size, 88, rng):
        first, second, third = inks[rng.permutation(len(inks))[:3]]
        radius, kind, turn = rng.uniform(22, 52), rng.integers(4), rng.uniform(0, np.pi)
        if kind == 0:
            for reach, ink in ((1.0, first), (0.7, second), (0.4, third)):
                _disc(mat, (x, y), radius * reach, ink)
        elif kind == 1:
            polygon(mat, _ring_of((x, y), radius, int(rng.integers(3, 6)), turn), first)
            _disc(mat, (x, y), radius * 0.35, second)
        elif kind == 2:
            for offset in range(-2, 3):
                direction = np.array([np.cos(turn), np.sin(turn)])
                middle = np.array([x, y]) + offset * 13 * direction[::-1] * (1, -1)
                ends = [middle - radius * direction, middle + radius * direction]
                line(mat, ends, first if offset % 2 else second, 6)
        else:
            _disc(mat, (x, y), radius, first, 11)
            _disc(mat, (x, y), radius * 0.55, second, 6)
    return mat


def puzzle(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Foam puzzle squares that interlock; the shape repeats, the colours do not."""
    side, inks = 154, bgr("ef476f", "ffd166", "06d6a0", "118ab2", "f78c6b", "9d4edd", "a7c957")
    rows, columns = -(-size[0] // side), -(-size[1] // side)
    color = np.zeros((rows, columns, 3), np.float32)
    for row, column in np.ndindex(rows, columns):
        # No two neighbours alike: draw again what the left and the upper square have not.
        used = [color[row, column - 1]] * (column > 0) + [color[row - 1, column]] * (row > 0)
        free = [ink for ink in inks if not any((ink == other).all() for other in used)]
        color[row, column] = free[rng.integers(len(free))]
    mat = np.repeat(np.repeat(color, side, axis=0), side, axis=1).astype(np.uint8)
    for row, column in np.ndindex(rows, columns):
        x, y = column * side, row * side
        for third in (0.3, 0.7):
            shift = 9 if (row + column + (third > 0.5)) % 2 else -9
            left, above = (column, row) if shift < 0 else (column - 1, row - 1)
            _disc(mat, (x + shift, y + third * side), 17, color[row, left])
            _disc(mat, (x + third * side, y + shift), 17, color[above, column])
    foam = grain(mat.shape[:2], rng, (1.5, 3.0))[..., None] * 7
    return np.clip(mat + foam, 0, 255).astype(np.uint8)[: size[0], : size[1]]


def terrazzo(size: tuple[int, int], rng: np.random.Generator) -> np.ndarray:
    """Stone chips in pale cement; never repeats."""
    mat = np.full((*size, 3), bgr("ece4db")[0], np.uint8)
    inks = bgr("9d6b53", "355070", "b56576", "6d8a74", "e0a458", "444444", "d8a48f")
    for x, y in _scatter(size, 25, rng):
        corners = int(rng.integers(4, 7))
        angle = np.sort(rng.uniform(0, 2 * np.pi, corners))
        reach = rng.uniform(4, 15, corners)
        chip = np.column_stack([x + reach * np.cos(angle), y + reach * np.sin(angle)])
        polygon(mat, chip, inks[rng.integers(len(inks))])
    return mat


MATS = {mat.__name__: mat for mat in (waves, tiles, rug, town, leaves, bauhaus, puzzle, terrazzo)}


@dataclass(frozen=True)
class Placement:
    """One mat: its print, centre and size in metres.

    Attributes
    ----------
    print_seed : int or None
        Mats of one seed and size show the same print to the pixel; None paints a new one.
    """

    mat: str
    x: float
    y: float
    width: float
    height: float
    print_seed: int | None = None


HALL = (
    Placement("rug", 0.98, 4.12, 1.50, 1.20),
    Placement("waves", 2.62, 4.22, 1.30, 1.05),
    Placement("town", 4.17, 3.93, 1.35, 1.50),
    Placement("tiles", 0.80, 2.42, 1.15, 1.30),
    Placement("bauhaus", 4.24, 2.16, 1.15, 1.25),
    Placement("puzzle", 0.96, 0.84, 1.50, 1.20),
    Placement("leaves", 2.66, 0.80, 1.30, 1.15),
    Placement("terrazzo", 4.26, 0.74, 1.20, 1.00),
)
