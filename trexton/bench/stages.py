"""A frame's stages timed where they happen, one after another, as `Localizer.step` runs them."""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np

from trexton.localizer import Estimate, Localizer, TextonMap

__all__ = ["STAGES", "StageClock"]

STAGES = ("histogram", "neighbors", "filter", "estimate")


class StageClock:
    """A localizer whose every stage has its own clock.

    Parameters
    ----------
    texton_map : TextonMap
    **options
        Of the localizer.

    Attributes
    ----------
    seconds : dict of str to list of float
        ``histogram`` (empty where frames are histograms), ``neighbors``, ``filter``, ``estimate``:
        one entry a frame.
    """

    def __init__(self, texton_map: TextonMap, **options: Any) -> None:
        self.localizer = Localizer(texton_map, mark=self._mark, **options)
        self.seconds: dict[str, list[float]] = {name: [] for name in STAGES}
        self._last = 0.0

    def _mark(self, stage: str) -> None:
        now = perf_counter()
        self.seconds[stage].append(now - self._last)
        self._last = now

    def step(self, frame: np.ndarray) -> Estimate:
        """One frame, an image or a histogram."""
        self._last = perf_counter()
        return self.localizer.step(frame)

    def medians(self) -> dict[str, float]:
        """Median seconds of each stage that was seen."""
        return {name: float(np.median(taken)) for name, taken in self.seconds.items() if taken}
