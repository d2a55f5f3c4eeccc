"""What ground the parts of an image show: places of their own, beside that of the frame.

A field over the places of frames knows little between two lanes of a survey. But an image that is
cut into parts shows the floor of several places at once, and what its left part sees from one lane
its right part saw from the next. Taken as one field over the ground, of which a frame sees as many
places as it has parts, a survey covers all that it has seen, not only where it was.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import isqrt

import numpy as np
from scipy.optimize import minimize
from scipy.spatial.distance import cdist

from trexton.field.blocks import Block, blocks_in_time
from trexton.field.grid import bilinear, grid_cells
from trexton.field.process import Process, negative_log_predictive_density
from trexton.localization.base import Area

__all__ = ["Tiles"]

MAX_FRAMES = 800  # frames among which look-alikes are sought
MAX_ROWS = 400  # parts of frames of which the likelihood is asked
LENGTH = 0.1  # of the kernel meanwhile, as a share of the diagonal of what was flown over
MIN_PAIRS = 10  # pairs of frames that must show the same ground
SIMPLEX_SIZE = 0.2  # of a step: how far from what look-alikes say the search begins
TOLERANCE = 0.02  # of a step, and of the likelihood of a feature
MAX_EVALUATIONS = 120
MIN_GAIN = 0.1  # of the likelihood of a feature, for which places of their own are taken
MAX_TILES = 16  # parts; of more, each sees little and all cost much
COARSE_CELLS = 1600  # cells of the grid on which variances are taken, which are smooth


@dataclass(frozen=True, eq=False)
class Tiles:
    """Where the parts of an image look, from the place of its frame.

    Attributes
    ----------
    offsets : (C, 2) array
        Metres in the map's axes from the place of a frame to what each part shows, in reading
        order; a single one of zeros where frames are taken as a whole.
    """

    offsets: np.ndarray

    @classmethod
    def of(cls, places: np.ndarray, features: np.ndarray, time: np.ndarray) -> Tiles:
        """As a training flight shows by itself, without camera and height.

        Two frames of which one shows to the left what the other shows to the right are as far from
        each other as its two parts. How far that is exactly the likelihood of left-out blocks
        tells, and whether one field of the ground foretells them at all: better than a field for
        each part, and better than one place for all parts, as of a camera that turned meanwhile.

        Parameters
        ----------
        places : (N, 2) array
            Metres.
        features : (N, C, k) array
            Of each of the C parts.
        time : (N,) array
            Seconds.
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

        def misfit(tiles: Tiles) -> float:
            values = features.reshape(len(places) * len(tiles.offsets), -1)
            process = Process.fit(tiles.places(places), values - values.mean(axis=0), length)
            return negative_log_predictive_density(process, tiles.blocks(blocks))[0]

        size = max(float(np.abs(steps).max()), 1e-3)
        corners = size * SIMPLEX_SIZE * np.vstack([np.zeros(4), np.eye(4)])
        best = minimize(
            lambda steps: misfit(cls.apart(steps.reshape(2, 2), parts)),
            steps.ravel(),
            method="Nelder-Mead",
            options={
                "initial_simplex": steps.ravel() + corners,
                "xatol": TOLERANCE * size,
                "fatol": TOLERANCE,
                "maxfev": MAX_EVALUATIONS,
            },
        )
        found, together = cls.apart(best.x.reshape(2, 2), parts), cls(np.zeros((parts, 2)))
        return found if best.fun < min(misfit(whole), misfit(together)) - MIN_GAIN else whole

    @classmethod
    def apart(cls, steps: np.ndarray, parts: int) -> Tiles:
        """So many parts, the steps ``(2, 2)`` from one to the next, to the right and down, given in
        metres; about the place of the frame.
        """
        middle = (isqrt(parts) - 1) / 2
        down, right = np.divmod(np.arange(parts), isqrt(parts))
        return cls((right - middle)[:, None] * steps[0] + (down - middle)[:, None] * steps[1])

    def places(self, places: np.ndarray) -> np.ndarray:
        """``(N C, 2)`` places of what the parts of frames at ``(N, 2)`` places show."""
        return (places[:, None] + self.offsets).reshape(-1, 2)

    def variance(self, process: Process, centers: np.ndarray, area: Area) -> np.ndarray:
        """``(M,)`` variance of the process, on average over what is shown from the centres of an
        area's cells; by way of a coarse grid where there are several parts.
        """
        if len(self.offsets) == 1:
            return process.variance(centers + self.offsets)
        reach = np.abs(self.offsets).max(axis=0)
        x, y = np.reshape(area, (2, 2)) + np.outer(reach, (-1, 1))
        wider = (*x.tolist(), *y.tolist())
        cells, shape = grid_cells(wider, COARSE_CELLS)
        grid, corners = process.variance(cells).reshape(shape), np.array(wider)
        found = [bilinear(grid, corners, centers + offset) for offset in self.offsets]
        return np.mean(found, axis=0)

    def blocks(self, blocks: Sequence[Block], every: int = 1) -> list[Block]:
        """Blocks of a flight's frames as blocks of the parts of every n-th of them."""
        return [block.of_every(every, len(self.offsets)) for block in blocks]


def _steps(places: np.ndarray, features: np.ndarray) -> np.ndarray | None:
    """``(2, 2)`` metres from a part to the next to the right, and to the next below, by the frames
    that look alike there; None where too few do.
    """
    side = isqrt(features.shape[1])
    number = np.arange(side**2).reshape(side, side)
    neighbors = (
        zip(number[:, :-1].ravel(), number[:, 1:].ravel(), strict=True),
        zip(number[:-1].ravel(), number[1:].ravel(), strict=True),
    )
    steps = []
    for pairs in neighbors:
        votes = [
            _apart(places, features[:, part], features[:, following]) for part, following in pairs
        ]
        joined = np.concatenate(votes)
        if len(joined) < MIN_PAIRS:
            return None
        steps.append(np.median(joined, axis=0))
    return np.array(steps)


def _apart(places: np.ndarray, features: np.ndarray, others: np.ndarray) -> np.ndarray:
    """``(n, 2)`` metres from the one to the other of two frames, of which one's features are most
    like the other's `others` and the other way round.
    """
    distance = cdist(features, others, "sqeuclidean")
    nearest = distance.argmin(axis=1)
    mutual = np.flatnonzero(distance.argmin(axis=0)[nearest] == np.arange(len(nearest)))
    return places[mutual] - places[nearest[mutual]]
