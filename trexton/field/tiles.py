"""The ground footprints of image tiles, learned from a survey: places beside that of the frame.

What the left tile of an image shows from one lane of a survey, its right tile showed from the next:
with one field over the ground a survey covers all that it has shown, not only where it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isqrt

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.distance import cdist

from trexton.field.likelihood import bilinear, grid_cells
from trexton.field.process import Block, Process, blocks_in_time, nlpd
from trexton.localization.base import Area

MAX_FRAMES = 800  # among which mutual nearest neighbours are sought
MAX_ROWS = 400  # tiles of frames of which the predictive density is taken
LENGTH = 0.1  # of the kernel meanwhile, as a share of the diagonal of what was flown over
MIN_PAIRS = 10  # of frames that must show the same ground
SIMPLEX_SIZE = 0.2  # of a step, of the initial simplex
TOLERANCE = 0.02  # of a step, and of the predictive density
MAX_EVALUATIONS = 120
MIN_GAIN = 0.1  # of predictive density, for which tiles get footprints of their own
MAX_TILES = 16  # of more, each shows little and all cost much
COARSE_CELLS = 1600  # of the grid on which variances are taken, which are smooth


@dataclass(frozen=True, eq=False)
class Tiles:
    """Footprints of an image's tiles, from the place of its frame.

    Attributes
    ----------
    offsets : (C, 2) array
        Metres in the map's axes from the place of a frame to what each part shows, in reading
        order; a single one of zeros where frames are taken as a whole.
    """

    offsets: np.ndarray

    @classmethod
    def of(
        cls, places: np.ndarray, features: np.ndarray, time: np.ndarray, ratio: float | None = None
    ) -> Tiles:
        """As a training flight shows by itself, without camera and height: ``(N, 2)`` places in
        metres, features ``(N, C, k)`` of each of the C tiles, and ``(N,)`` seconds.

        Two frames of which one shows to the left what the other shows to the right are as far from
        each other as these two tiles. The predictive density of left-out blocks says how far that
        is exactly, and whether one field of the ground predicts them at all: better than a field
        for each tile, and better than one place for all tiles, as of a camera that turned. With the
        `ratio` of the images' height to their width, whose pixels are square, boards that look
        alike along their length are measured across them.
        """
        whole, parts = cls(np.zeros((1, 2))), features.shape[1]
        if parts == 1 or parts > MAX_TILES:
            return whole
        step = -(-len(places) // MAX_FRAMES)
        steps = _steps(places[::step], features[::step])
        if steps is None:
            return whole
        thinned = slice(None, None, -(-len(places) * parts // MAX_ROWS))
        places, features = places[thinned], features[thinned]
        blocks = blocks_in_time(time[thinned])
        length = LENGTH * max(float(np.hypot(*np.ptp(places, axis=0))), 1e-3)

        together = cls(np.zeros((parts, 2)))
        of_tiles = together.blocks(blocks)

        def density(tiles: Tiles) -> float:
            values = features.reshape(len(places) * len(tiles.offsets), -1)
            process = Process(tiles.places(places), values - values.mean(axis=0), length)
            return nlpd(process, of_tiles if len(tiles.offsets) > 1 else blocks)[0]

        free = np.eye(4)  # both steps, as a linear function of what is sought
        if ratio is not None:
            down = -ratio * np.sign(np.linalg.det(steps))
            free = np.array([[1, 0], [0, 1], [0, down], [-down, 0]])
        start = np.linalg.lstsq(free, steps.ravel())[0]
        size = max(float(np.abs(steps).max()), 1e-3)
        corners = size * SIMPLEX_SIZE * np.eye(len(start) + 1, len(start), -1)
        best = minimize(
            lambda sought: density(cls.apart((free @ sought).reshape(2, 2), parts)),
            start,
            method="Nelder-Mead",
            options={
                "initial_simplex": start + corners,
                "xatol": TOLERANCE * size,
                "fatol": TOLERANCE,
                "maxfev": MAX_EVALUATIONS,
            },
        )
        fitted = cls.apart((free @ best.x).reshape(2, 2), parts)
        return fitted if best.fun < min(density(whole), density(together)) - MIN_GAIN else whole

    @classmethod
    def apart(cls, steps: np.ndarray, parts: int) -> Tiles:
        """So many tiles about the place of the frame; steps ``(2, 2)`` in metres from one to the
        next, to the right and down.
        """
        middle = (isqrt(parts) - 1) / 2
        down, right = np.divmod(np.arange(parts), isqrt(parts))
        return cls((right - middle)[:, None] * steps[0] + (down - middle)[:, None] * steps[1])

    def places(self, places: np.ndarray) -> np.ndarray:
        """``(N C, 2)`` footprints of frames at ``(N, 2)`` places."""
        return (places[:, None] + self.offsets).reshape(-1, 2)

    def variance(self, process: Process, centers: np.ndarray, area: Area) -> np.ndarray:
        """``(M,)`` variance of the process, on average over the footprints from the centres of an
        area's cells; by way of a coarse grid where there are several tiles.
        """
        if len(self.offsets) == 1:
            return process.variance(centers + self.offsets)
        reach = np.abs(self.offsets).max(axis=0)
        x, y = np.reshape(area, (2, 2)) + np.outer(reach, (-1, 1))
        wider = (*x.tolist(), *y.tolist())
        cells, shape = grid_cells(wider, COARSE_CELLS)
        grid, corners = process.variance(cells).reshape(shape), np.array(wider)
        return np.mean([bilinear(grid, corners, centers + each) for each in self.offsets], axis=0)

    def blocks(self, blocks: Sequence[Block], every: int = 1) -> list[Block]:
        """Blocks of a flight's frames as blocks of the tiles of every n-th of them."""
        count = len(self.offsets)

        def of_tiles(rows: np.ndarray) -> np.ndarray:
            kept = rows[rows % every == 0] // every
            return (kept[:, None] * count + np.arange(count)).ravel()

        return [Block(of_tiles(block.rows), of_tiles(block.left_out)) for block in blocks]


def _steps(places: np.ndarray, features: np.ndarray) -> np.ndarray | None:
    """``(2, 2)`` metres from a tile to the next to the right, and to the next below, by mutual
    nearest neighbours among the frames; None where there are too few.
    """
    side = isqrt(features.shape[1])
    number = np.arange(side**2).reshape(side, side)
    steps = []
    for tiles, following in ((number[:, :-1], number[:, 1:]), (number[:-1], number[1:])):
        pairs = zip(tiles.ravel(), following.ravel(), strict=True)
        votes = [_apart(places, features[:, one], features[:, other]) for one, other in pairs]
        joined = np.concatenate(votes)
        if len(joined) < MIN_PAIRS:
            return None
        steps.append(np.median(joined, axis=0))
    return np.array(steps)


def _apart(places: np.ndarray, features: np.ndarray, others: np.ndarray) -> np.ndarray:
    """``(n, 2)`` metres between mutual nearest neighbours, frames by `features` and by `others`."""
    distance = cdist(features, others, "sqeuclidean")
    nearest = distance.argmin(axis=1)
    mutual = np.flatnonzero(distance.argmin(axis=0)[nearest] == np.arange(len(nearest)))
    return places[mutual] - places[nearest[mutual]]
