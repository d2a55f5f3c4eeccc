"""Histograms of a whole flight, a chunk of frames after the other; what is counted is kept.

So a training that was stopped goes on where it was, and holds no more than a frame at a time.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import islice

import numpy as np

from trexton.base.errors import MapError
from trexton.base.progress import progress, say
from trexton.flights.flight import Flight
from trexton.vision.histograms import texton_counts
from trexton.vision.textons import TextonDictionary
from trexton.vision.threads import ahead

__all__ = ["CHUNK", "full_histograms"]

CHUNK = 250  # frames, a second or two; shorter flights are not worth keeping
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
    bar = progress(range(len(flight)), "histograms", total=len(flight))
    counts = _all_counts(flight, dictionary, _PARTS if cells == 1 else cells, bar)
    if cells == 1:
        counts = counts.reshape(len(flight), _PARTS**2, -1).sum(axis=1)
    return counts / counts.sum(axis=1, keepdims=True)


def _all_counts(
    flight: Flight, dictionary: TextonDictionary, cells: int, bar: Iterator[int]
) -> np.ndarray:
    if len(flight) <= CHUNK:
        return _counted(flight, dictionary, cells, bar)
    parts = [flight.select(slice(first, first + CHUNK)) for first in range(0, len(flight), CHUNK)]
    kept = [_kept(part, dictionary, cells, bar) for part in parts]
    if reused := sum(len(counts) for counts, fresh in kept if not fresh):
        say(f"{reused} of {len(flight)} frames had been counted before")
    return np.concatenate([counts for counts, _ in kept])


def _kept(
    part: Flight, dictionary: TextonDictionary, cells: int, bar: Iterator[int]
) -> tuple[np.ndarray, bool]:
    """The counts of a chunk, and whether they were made just now."""
    from trexton.base.cache import cached  # which an onboard computer never needs

    counted: list[np.ndarray] = []

    def compute() -> dict[str, np.ndarray]:
        counted.append(_counted(part, dictionary, cells, bar))
        return {"counts": counted[0]}

    assert part.frames is not None  # only images are counted
    inputs = {
        "frames": part.frames.digest,
        "textons": [dictionary.textons.shape, dictionary.textons.tobytes().hex()],
        "cells": cells,
    }
    counts = cached("counts", "trexton.vision.histograms", inputs, compute)["counts"]
    if not counted:
        list(islice(bar, len(part)))
    return counts, bool(counted)


def _counted(
    part: Flight, dictionary: TextonDictionary, cells: int, bar: Iterator[int]
) -> np.ndarray:
    """``(N, K cells^2) int32``"""
    images = (image for image, _ in zip(part.images(), bar, strict=False))
    count = partial(texton_counts, dictionary=dictionary, cells=cells)
    return np.stack(list(ahead(count, images))).astype(np.int32)
