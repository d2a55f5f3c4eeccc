"""The training flight flown again as if each frame were new: what a method's errors will be like.

No frame finds neighbours in the time around it, which look like it and would flatter the map; all
others stay, for a later flight finds them as well. The flight is flown forwards and backwards.
Histograms of full sampling are drawn anew, as a flight that samples sees them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np

from trexton.base.errors import MapError
from trexton.localization.base import Training
from trexton.localization.localizer import Localizer
from trexton.localization.measurement import EXCLUDED_SECONDS
from trexton.localization.neighbors import Neighbors, neighbors_in_flight
from trexton.localization.observation import Observation
from trexton.localization.replay import WARM_S, Flown
from trexton.localization.texton_map import JUDGES, TextonMap

__all__ = ["flown_unseen", "unseen"]


def unseen(training: Training, samples: int) -> tuple[np.ndarray, list[Neighbors]]:
    """``(N, K)`` histograms as a flight sees them, and the neighbours each has at other times.

    Raises
    ------
    MapError
        Some frame has too few.
    """
    histograms = training.histograms
    if training.dictionary is not None:
        shares = histograms / histograms.sum(axis=1, keepdims=True)
        histograms = training.rng.multinomial(samples, shares) / samples
    nearest, distance = training.nearest, training.distance
    rows = neighbors_in_flight(nearest, histograms, training.time, nearest.k, EXCLUDED_SECONDS)
    apart = [
        distance.between(each[None], training.histograms[near])[0]
        for each, near in zip(histograms, rows, strict=True)
    ]
    found = zip(rows, apart, training.positions[rows], strict=True)
    return histograms, [Neighbors(*each) for each in found]


def flown_unseen(
    texton_map: TextonMap, *, samples: int, rng: np.random.Generator
) -> Iterator[Flown]:
    """Fly a map's own training flight.

    Parameters
    ----------
    texton_map : TextonMap
        Whose parts say which method; calibration and integrity do not fly.
    samples : int
        Patches a frame, where the map has a dictionary.
    rng : numpy.random.Generator

    Raises
    ------
    MapError
        The flight is too short.
    """
    settled = round(WARM_S / texton_map.period_s)
    if len(texton_map.histograms) < 2 * settled:
        raise MapError(
            f"the training flight has {len(texton_map.histograms)} frames: what a method's errors "
            f"are like takes at least {2 * settled}, record a longer one or choose calibration=none"
        )
    parts = {role: part for role, part in texton_map.parts.items() if role not in JUDGES}
    method = replace(texton_map, parts=parts)
    histograms, neighbors = unseen(replace(method.training(rng=rng), texton_map=method), samples)
    drawn = samples if texton_map.dictionary is not None else None
    localizer = Localizer(method, rng=rng)
    every = range(len(histograms))
    for order in (every, every[::-1]):
        localizer.reset()
        for since, row in enumerate(order):
            observation = Observation(
                samples=drawn,
                histogram=partial(histograms.__getitem__, row),
                neighbors=partial(_found, neighbors[row]),
            )
            estimate = localizer.advance(observation)
            if since >= settled:
                yield Flown(row, texton_map.positions[row], estimate, neighbors[row])


def _found(neighbors: Neighbors, histogram: np.ndarray) -> Neighbors:
    """What a search would find, which was made already."""
    return neighbors
