"""What the parts of a method learn from. Offers `Training`: a training set, and neighbours at other
times."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from trexton.base.streams import generator
from trexton.localization.base import Area
from trexton.localization.neighbors import Distance, NearestHistograms, neighbors_in_flight
from trexton.vision.textons import TextonDictionary

if TYPE_CHECKING:
    from trexton.flights.flight import Flight
    from trexton.localization.texton_map import TextonMap

# Frames closer in time than this see nearly the same floor: as neighbours they would flatter the
# map. With half a second the k-NN errs on the training flight about as much as on a fresh flight of
# the virtual room.
EXCLUDED_SECONDS = 0.5


@dataclass(frozen=True, eq=False)
class Training:
    """What parts learn from.

    Attributes
    ----------
    histograms : (N, K) array
        Relative texton frequencies, full sampling; or other features, as the flight has them.
    positions : (N, 2) array, metres
    time : (N,) array, seconds
    area : (x_min, x_max, y_min, y_max)
    period_s : float
        Median time from frame to frame.
    distance : Distance
        Between histograms, the one that flies.
    dictionary : TextonDictionary or None
        None where the flight came as histograms.
    flight : Flight or None
        The frames themselves, in the same order, where they were kept.
    rng : numpy.random.Generator
    cells : int
        Parts of the image along each side, each with a histogram of its own.
    """

    histograms: np.ndarray
    positions: np.ndarray
    time: np.ndarray
    area: Area
    period_s: float
    distance: Distance
    dictionary: TextonDictionary | None
    flight: Flight | None
    rng: np.random.Generator
    cells: int = 1

    @cached_property
    def nearest(self) -> NearestHistograms:
        """The search that flies, over the training set itself."""
        return NearestHistograms(self.histograms, self.positions, k=1, distance=self.distance)

    def neighbors(self, k: int, excluded_s: float) -> np.ndarray:
        """``(N, k)`` rows of the nearest histograms of each frame, without those up to `excluded_s`
        seconds apart. Raises `MapError` where some frame has fewer than k others.
        """
        return neighbors_in_flight(self.nearest, self.histograms, self.time, k, excluded_s)

    def drawn(self, samples: int) -> np.ndarray:
        """``(N, K)`` histograms as a flight sees them that draws so many patches a frame."""
        if self.dictionary is None:
            return self.histograms
        shares = self.histograms / self.histograms.sum(axis=1, keepdims=True)
        return self.rng.multinomial(samples, shares) / samples


def training_set(
    texton_map: TextonMap, *, flight: Flight | None = None, rng: np.random.Generator | None = None
) -> Training:
    """What the parts learn from; see `trexton.localization.training.with_parts`."""
    return Training(
        texton_map.histograms,
        texton_map.positions,
        texton_map.time,
        texton_map.area,
        texton_map.period_s,
        texton_map.distance,
        texton_map.dictionary,
        flight,
        np.random.default_rng(0) if rng is None else generator(rng),
        cells=texton_map.cells,
    )
