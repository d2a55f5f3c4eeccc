"""A frame's stages timed where they happen, one after another, as `Localizer.step` runs them."""

from __future__ import annotations

from time import perf_counter

import numpy as np

from trexton.histograms import sampled_histogram, texton_histogram
from trexton.localizer import Localizer

__all__ = ["StageClock"]


class StageClock:
    """Steps a localizer part by part, each part with its own clock.

    Parameters
    ----------
    localizer : Localizer

    Attributes
    ----------
    seconds : dict of str to list of float
        ``histogram`` (empty where frames are histograms), ``neighbors``, ``filter``, ``estimate``: one entry
        a frame.
    """

    def __init__(self, localizer: Localizer):
        self.localizer = localizer
        names = ("histogram", "neighbors", "filter", "estimate")
        self.seconds: dict[str, list[float]] = {name: [] for name in names}

    def step(self, frame: np.ndarray) -> None:
        """One frame, an image or a histogram."""
        localizer, marks = self.localizer, [perf_counter()]
        names = list(self.seconds)
        if frame.ndim == 1:
            names.remove("histogram")
            histogram = frame
        else:
            histogram = self._histogram(frame)
            marks.append(perf_counter())
        neighbors = localizer.nearest.query(histogram)
        marks.append(perf_counter())
        localizer.filter.step(neighbors.position)
        marks.append(perf_counter())
        localizer.filter.estimate()
        localizer.filter.moments()
        marks.append(perf_counter())
        for name, start, end in zip(names, marks, marks[1:]):
            self.seconds[name].append(end - start)

    def _histogram(self, image: np.ndarray) -> np.ndarray:
        localizer = self.localizer
        if localizer.samples is None:
            return texton_histogram(image, localizer.map.dictionary)
        return sampled_histogram(
            image, localizer.map.dictionary, localizer.samples, rng=localizer.rng
        )

    def medians(self) -> dict[str, float]:
        """Median seconds of each stage that was seen."""
        return {name: float(np.median(taken)) for name, taken in self.seconds.items() if taken}
