"""Blocked cross-validation of a training flight: stretches of it are flown by maps that did not see
them, so that settings can be compared before there is a test flight.

Stretches are left out in pairs, the method is trained on the rest, and the stretches are flown,
forwards and backwards. Histograms of full sampling are drawn anew, as a flight that samples sees
them; the dictionary stays.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from trexton.base.errors import MapError
from trexton.flights.aiding import Aiding
from trexton.localization.cross_validation import WARM_S
from trexton.localization.estimate import Flown
from trexton.localization.localizer import Localizer
from trexton.localization.texton_map import TextonMap
from trexton.localization.training import with_parts
from trexton.localization.training_set import EXCLUDED_SECONDS

__all__ = ["replay", "stretches"]

STRETCH_S = 5.0
MOST_STRETCHES = 8


def stretches(time: np.ndarray) -> list[np.ndarray]:
    """Rows of the stretches that are left out, those in which a filter settles included, evenly
    spread over the flight.

    Raises
    ------
    MapError
        The flight is too short.
    """
    lasts = float(time[-1] - time[0])
    if lasts < 4 * (WARM_S + 1):
        raise MapError(
            f"the training flight lasts {lasts:.1f} s: what a method's errors are like "
            f"takes at least {4 * (WARM_S + 1):g} s, "
            "record a longer one"
        )
    whole = min(STRETCH_S + WARM_S, lasts / 4)  # two of them leave at least half to learn from
    count = max(2, min(MOST_STRETCHES, int(lasts / (whole - WARM_S))))
    starts = np.linspace(time[0], time[-1] - whole, count)
    return [np.flatnonzero((time >= start) & (time < start + whole)) for start in starts]


def replay(
    texton_map: TextonMap,
    *,
    samples: int | None,
    rng: np.random.Generator,
    aidings: Sequence[Aiding | None] | None = None,
) -> Iterator[Flown]:
    """Fly the left-out stretches of a map's own training flight, without the frames in which the
    filter settles.

    Parameters
    ----------
    texton_map : TextonMap
        Whose parts say which method; calibration, integrity and odometry do not fly.
    samples : int or None
        Patches a frame, where the map has a dictionary; None looks at every one.
    rng : numpy.random.Generator
    aidings : sequence of Aiding, optional
        What came beside each frame of the training flight; of it velocities alone are used.

    Raises
    ------
    MapError
        The flight is too short.
    """
    apart = ("calibration", "integrity", "odometry")
    parts = {role: part for role, part in texton_map.parts.items() if role not in apart}
    drawn = samples if texton_map.dictionary is not None else None
    every = stretches(texton_map.time)
    half = len(every) // 2
    for pair in zip(every[:half], every[half:], strict=False):
        rest = _without(replace(texton_map, parts={}), np.concatenate(pair))
        untrained = {role: part.untrained() for role, part in parts.items()}
        method = with_parts(rest, untrained, rng=rng)
        for order in (pair, [rows[::-1] for rows in pair[::-1]]):
            localizer = Localizer(method, rng=rng)
            for rows in order:
                localizer.reset()
                for since, row in enumerate(rows):
                    histogram = texton_map.histograms[row]
                    if drawn is not None:
                        histogram = rng.multinomial(drawn, histogram / histogram.sum()) / drawn
                    aiding = _on_the_way(aidings, rows[since - 1], row) if since else None
                    observation = localizer.observation(histogram, aiding=aiding, samples=drawn)
                    estimate = localizer.advance(observation)
                    if since * texton_map.period_s >= WARM_S:
                        place = texton_map.positions[row]
                        yield Flown(row, place, estimate, observation.neighbors)


def _without(texton_map: TextonMap, rows: np.ndarray) -> TextonMap:
    time = texton_map.time
    near = np.searchsorted(time[np.sort(rows)], [time - EXCLUDED_SECONDS, time + EXCLUDED_SECONDS])
    return texton_map.select(np.flatnonzero(near[0] == near[1]))


def _on_the_way(aidings: Sequence[Aiding | None] | None, last: int, row: int) -> Aiding | None:
    """The velocity from one row to the next, or back: it came with the later of them."""
    known = None if aidings is None else aidings[max(last, row)]
    if known is None or known.velocity is None:
        return None
    velocity = known.velocity if row > last else -known.velocity
    return Aiding(velocity=velocity, velocity_sigma=known.velocity_sigma)
