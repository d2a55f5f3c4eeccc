"""Histograms of a whole flight, by full sampling. Offers `full_histograms`, which keeps its counts
in the cache, so that the next training on these frames has them."""

from __future__ import annotations

from functools import partial

import numpy as np

from trexton.base.errors import MapError
from trexton.base.progress import progress
from trexton.flights.flight import Flight
from trexton.vision.histograms import texton_counts
from trexton.vision.textons import TextonDictionary
from trexton.vision.threads import ahead

__all__ = ["full_histograms"]

KEPT_FROM = 250  # frames; shorter flights are counted in a second or two
_PARTS = 2  # a side: images are counted in quarters, whose sum serves methods that take the whole


def full_histograms(
    flight: Flight, dictionary: TextonDictionary | None, cells: int = 1
) -> np.ndarray:
    """``(N, K)`` histograms of a flight: full sampling of its images, or those that it brings.

    Raises
    ------
    MapError
        The flight has neither.
    """
    if dictionary is None or not flight.has_images:
        if flight.histograms is None:
            raise MapError(
                f"flight {flight.name!r} has no histograms: give a dictionary to count by"
            )
        return flight.histograms
    counts = _counts(flight, dictionary, _PARTS if cells == 1 else cells)
    if cells == 1:
        counts = counts.reshape(len(flight), _PARTS**2, -1).sum(axis=1)
    return counts / counts.sum(axis=1, keepdims=True)


def _counts(flight: Flight, dictionary: TextonDictionary, cells: int) -> np.ndarray:
    """``(N, K cells^2) int32``"""

    def compute() -> dict[str, np.ndarray]:
        images = progress(flight.images(), "histograms", total=len(flight))
        count = partial(texton_counts, dictionary=dictionary, cells=cells)
        return {"counts": np.stack(list(ahead(count, images))).astype(np.int32)}

    if len(flight) < KEPT_FROM:
        return compute()["counts"]
    from trexton.base.cache import cached  # which an onboard computer never needs

    assert flight.frames is not None  # only images are counted
    inputs = {
        "frames": flight.frames.digest,
        "textons": [dictionary.textons.shape, dictionary.textons.tobytes().hex()],
        "cells": cells,
    }
    return cached("counts", "trexton.vision.histograms", inputs, compute)["counts"]
