"""What a frame brings to a filter: the picture, and what a part asks for. Offers `Observation`,
which computes histograms and the like once and only when asked."""

from collections.abc import Callable
from functools import cached_property

import numpy as np

from trexton.flights.aiding import Aiding
from trexton.localization.neighbors import Neighbors


class Observation:
    """One frame; its histogram and neighbours are computed on first use and kept.

    Parameters
    ----------
    frame : (H, W, 3) uint8 array or None
        The picture; None where the flight came as histograms.
    aiding, time, samples : optional
        As of `Localizer.step`.
    histogram, neighbors : callable
        Give the ``(K,)`` histogram, and the neighbours of a histogram.
    """

    def __init__(
        self,
        frame: np.ndarray | None = None,
        *,
        aiding: Aiding | None = None,
        time: float | None = None,
        samples: int | None = None,
        histogram: Callable[[], np.ndarray],
        neighbors: Callable[[np.ndarray], Neighbors] | None = None,
    ):
        self.frame, self.time, self.samples = frame, time, samples
        self.aiding = Aiding() if aiding is None else aiding
        self._count, self._search = histogram, neighbors
        self.familiar = True  # False: it fits no place as the floor looks now, and measures none
        self.since_s: float | None = None  # the filter was advanced; None: a period
        self.velocity_seen: np.ndarray | None = None  # (2,) m/s, what the frames themselves show

    @cached_property
    def histogram(self) -> np.ndarray:
        """``(K,)`` texton frequencies of the frame."""
        return self._count()

    @cached_property
    def neighbors(self) -> Neighbors:
        """The most similar training histograms."""
        assert self._search is not None  # every localizer gives it
        return self._search(self.histogram)
