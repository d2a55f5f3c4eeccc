"""Leave-neighbours-out cross-validation: the training flight flown again for a method's errors.

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
from trexton.localization.estimate import Flown
from trexton.localization.neighbors import Neighbors
from trexton.localization.observation import Observation
from trexton.localization.pipeline import Pipeline
from trexton.localization.texton_map import JUDGES, TextonMap
from trexton.localization.training_set import Training

__all__ = ["WARM_S", "leave_neighbors_out"]

WARM_S = 2.0  # in which a filter settles: flown, but not judged


def leave_neighbors_out(texton_map: TextonMap, training: Training, samples: int) -> Iterator[Flown]:
    """Fly a map's own training flight.

    Parameters
    ----------
    texton_map : TextonMap
        Whose parts say which method; calibration and integrity do not fly.
    training : Training
        Of that flight.
    samples : int
        Patches a frame, where the map has a dictionary.

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
    histograms, neighbors = training.resampled(samples)
    drawn = samples if texton_map.dictionary is not None else None
    pipeline = Pipeline(method, rng=training.rng)
    every = range(len(histograms))
    for order in (every, every[::-1]):
        pipeline.reset()
        for since, row in enumerate(order):
            observation = Observation(
                samples=drawn,
                histogram=partial(histograms.__getitem__, row),
                neighbors=partial(_found, neighbors[row]),
            )
            estimate = pipeline.advance(observation)
            if since >= settled:
                yield Flown(row, texton_map.positions[row], estimate, neighbors[row])


def _found(neighbors: Neighbors, histogram: np.ndarray) -> Neighbors:
    """What a search would find, which was made already."""
    return neighbors
