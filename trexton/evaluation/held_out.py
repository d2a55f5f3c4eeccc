"""Blocked cross-validation of a training flight: stretches of it are flown by maps that did not see
them, so that methods and settings can be compared before there is a test flight.

Histograms of full sampling are drawn anew, as a flight that samples sees them, unless the images
are given; the dictionary stays.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from trexton.base.defaults import SAMPLES
from trexton.base.errors import MapError
from trexton.flights.flight import Flight
from trexton.localization.estimate import CHI2_90, Estimate
from trexton.localization.localizer import Localizer
from trexton.localization.texton_map import TextonMap
from trexton.localization.training import with_parts
from trexton.localization.training_set import EXCLUDED_SECONDS

WARM_S = 2.0  # in which a filter settles: flown, but not judged
STRETCH_S = 5.0
MOST_STRETCHES = 8
PAUSE = 1.5  # of the frames' period: what is longer is a pause by the rest
LEAST_COVERAGE = 0.8  # of the 90 % region, for a covariance that others may believe


@dataclass(frozen=True)
class Assessment:
    """What a method showed on stretches of its training flight that its map had not seen.

    Attributes
    ----------
    frames : int
    error_m : float
        Mean, of all frames.
    lost_share : float
        Of frames that were called lost.
    coverage_90 : float or None
        Empirical coverage of the 90 % region: the share of the other frames whose true position lay
        in it; None where all were called lost.
    wide_share : float
        Of the lost frames, those whose claim alone is too wide for the area.
    """

    frames: int
    error_m: float
    lost_share: float
    coverage_90: float | None
    wide_share: float = 0.0


def assess(
    texton_map: TextonMap, flight: Flight | None = None, *, rng: np.random.Generator
) -> Assessment:
    """Fly the left-out stretches, and say what that amounts to.

    Parameters and errors are those of `replay`; frames may also be too rare.
    """
    flown = list(replay(texton_map, samples=SAMPLES, rng=rng, flight=flight))
    if not flown:
        raise MapError(f"a frame in {texton_map.period_s:.1f} s: record more of them a second")
    errors, wide, inside = [], [], []
    for truth, estimate in flown:
        errors.append(error := estimate.position - truth)
        if estimate.lost_in(texton_map.area):
            wide.append(not estimate.lost)
        else:
            inside.append(error @ np.linalg.solve(estimate.about_position, error) <= CHI2_90)
    return Assessment(
        len(flown),
        float(np.hypot(*np.transpose(errors)).mean()),
        1 - len(inside) / len(flown),
        float(np.mean(inside)) if inside else None,
        float(np.mean(wide)) if wide else 0.0,
    )


def stretches(time: np.ndarray) -> list[np.ndarray]:
    """Rows of the stretches that are left out, those in which a filter settles included, evenly
    spread over the flight.

    Raises
    ------
    MapError
        The flight is too short.
    """
    gaps = np.diff(time)
    paused = np.maximum(gaps - PAUSE * np.median(gaps), 0)  # there nothing was flown
    time = time - np.append(0, paused.cumsum())
    lasts = float(time[-1] - time[0])
    if lasts < (least := 4 * (WARM_S + 1)):
        raise MapError(f"{lasts:.1f} s of flight: record a longer one, of at least {least:g} s")
    whole = min(STRETCH_S + WARM_S, lasts / 4)  # two of them leave at least half to learn from
    count = max(2, min(MOST_STRETCHES, int(lasts / (whole - WARM_S))))
    starts = np.linspace(time[0], time[-1] - whole, count)
    return [np.flatnonzero((time >= start) & (time < start + whole)) for start in starts]


def replay(
    texton_map: TextonMap,
    *,
    samples: int | None,
    rng: np.random.Generator,
    flight: Flight | None = None,
) -> Iterator[tuple[np.ndarray, Estimate]]:
    """Fly the left-out stretches of a map's own training flight: the true place in metres and the
    estimate of each frame, without those in which the filter settles.

    Parameters
    ----------
    texton_map : TextonMap
        Whose parts say which method.
    samples : int or None
        Patches a frame, where the map has a dictionary; None looks at every one.
    rng : numpy.random.Generator
    flight : Flight, optional
        The frames behind the map: then its images are flown, with roll, pitch and height.

    Raises
    ------
    MapError
        The flight is too short.
    """
    # Odometry asks for images at the rate of the flight, not for stretches of histograms.
    parts = {role: part for role, part in texton_map.parts.items() if role != "odometry"}
    drawn = samples if texton_map.dictionary is not None else None
    every = stretches(texton_map.time)
    half = len(every) // 2
    for pair in zip(every[:half], every[half:], strict=False):
        time, rows = texton_map.time, np.sort(np.concatenate(pair))
        near = np.searchsorted(time[rows], [time - EXCLUDED_SECONDS, time + EXCLUDED_SECONDS])
        kept = np.flatnonzero(near[0] == near[1])  # that are not, and do not look like, these
        rest = replace(texton_map, parts={}).select(kept)
        untrained = {role: part.untrained() for role, part in parts.items()}
        frames = None if flight is None else flight.select(kept)
        method = with_parts(rest, untrained, flight=frames, rng=rng)
        for order in (pair, [rows[::-1] for rows in pair[::-1]]):
            localizer = Localizer(method, rng=rng)
            for rows in order:
                localizer.reset()
                for since, row in enumerate(rows):
                    aiding = None
                    if flight is not None:
                        frame, aiding = flight.image(row), flight.aiding(row).without_heading()
                    else:
                        frame = texton_map.histograms[row]
                        if drawn is not None:
                            frame = rng.multinomial(drawn, frame / frame.sum()) / drawn
                    observation = localizer.observation(frame, aiding=aiding, samples=drawn)
                    estimate = localizer.advance(observation)
                    if since * texton_map.period_s >= WARM_S:
                        yield texton_map.positions[row], estimate
