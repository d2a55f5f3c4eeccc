"""Settings for a computer and a rate: what a frame costs here, and what it would lose in accuracy.

Costs are measured on this machine, stage by stage. Errors are those of the trade-off experiment,
which varied samples and particles one at a time; their effects are taken to add up.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from trexton.bench.stages import StageClock
from trexton.errors import ParameterError
from trexton.localizer import TextonMap
from trexton.records import Record

__all__ = ["Setting", "choose", "costs", "predicted_errors", "tune"]

_ERROR = "axis_mean_cm"  # mean absolute error over both axes
_TOLERANCE = 0.02  # differences in error below this are not worth any time


@dataclass(frozen=True)
class Setting:
    """Samples (None: every patch) and particles, a frame's seconds here, and the error to expect in
    cm.
    """

    samples: int | None
    particles: int
    frame_s: float
    error_cm: float


def tune(
    texton_map: TextonMap,
    record: Record,
    rate: float,
    *,
    headroom: float = 0.5,
    rng: np.random.Generator,
) -> Setting:
    """The setting to use on this machine at a given rate.

    Parameters
    ----------
    texton_map : TextonMap
    record : Record
        Of the experiment ``trade_off``.
    rate : float
        Frames a second.
    headroom : float
        Share of each frame's period that stays free.
    rng : numpy.random.Generator
        For the frames and the filter that are timed.

    Raises
    ------
    ParameterError
        The rate or the headroom is out of range, the record is of another experiment, or nothing is
        fast enough.
    """
    if not 0 < rate < np.inf:
        raise ParameterError(f"the rate is {rate} Hz: expected a positive number")
    if not 0 <= headroom < 1:
        raise ParameterError(
            f"the headroom is {headroom}: expected a share from 0 up to 1, 0.5 to keep half of the "
            "time free"
        )
    errors = predicted_errors(record, with_samples=texton_map.dictionary is not None)
    samples, particles = zip(*errors, strict=False)
    frame_s = costs(texton_map, sorted(set(samples), key=_amount), sorted(set(particles)), rng=rng)
    settings = [Setting(*key, frame_s[key], error) for key, error in errors.items()]
    return choose(settings, (1 - headroom) / rate)


def choose(settings: list[Setting], budget_s: float) -> Setting:
    """The cheapest of those within the budget whose error is within two per cent of the best of
    them.

    Raises
    ------
    ParameterError
        None is within the budget.
    """
    affordable = [setting for setting in settings if setting.frame_s <= budget_s]
    if not affordable:
        cheapest = min(settings, key=lambda setting: setting.frame_s)
        raise ParameterError(
            f"even {cheapest.samples} samples and {cheapest.particles} particles take "
            f"{1000 * cheapest.frame_s:.3g} ms a frame, but {1000 * budget_s:.3g} ms are to spend: "
            "lower the rate or the headroom"
        )
    enough = min(setting.error_cm for setting in affordable) * (1 + _TOLERANCE)
    return min(
        (one for one in affordable if one.error_cm <= enough), key=lambda setting: setting.frame_s
    )


def predicted_errors(
    record: Record, *, with_samples: bool = True
) -> dict[tuple[int | None, int], float]:
    """Error in cm for every pair of samples and particles that the record varied.

    Without samples (a map of histograms only) the first of each pair is the record's default and
    stands for nothing.
    """
    if record.experiment != "trade_off":
        raise ParameterError(f"the record is of {record.experiment!r}: expected one of 'trade_off'")
    default = {name: record.parameters[name] for name in ("samples", "particles")}
    if with_samples and "samples" not in record.series:
        raise ParameterError(
            f"the trade-off of {record.flight!r} did not vary samples, as it had no images: "
            "give the record of a flight with images"
        )
    names = ("samples", "particles") if with_samples else ("particles",)
    swept = {name: _sweep(record, name) for name in names}
    base = swept["particles"][default["particles"]]
    by_samples = swept.get("samples", {default["samples"]: base})
    reference = by_samples[default["samples"]]
    return {
        (drawn, count): max(0.0, base + (first - reference) + (second - base))
        for (drawn, first), (count, second) in product(
            by_samples.items(), swept["particles"].items()
        )
    }


def _sweep(record: Record, name: str) -> dict[Any, float]:
    return {row[name]: row[_ERROR]["median"] for row in record.series[name]}


def costs(
    texton_map: TextonMap,
    samples: list[int | None],
    particles: list[int],
    *,
    rng: np.random.Generator,
    repeats: int = 60,
) -> dict[tuple[int | None, int], float]:
    """Median seconds a frame takes here for every pair; histograms and filters are timed once, and
    added.
    """
    if texton_map.dictionary is None:
        frames = list(texton_map.histograms[:repeats])
        of_samples = dict.fromkeys(samples, 0.0)
    else:
        # What is in the picture does not change the time; reading fresh memory does.
        assert texton_map.image_shape is not None  # it has a dictionary
        shape = (*texton_map.image_shape, 3)
        frames = [np.asarray(rng.integers(0, 256, shape, dtype=np.uint8)) for _ in range(8)]
        of_samples = {
            drawn: _stage_medians(texton_map, frames, repeats, rng, samples=drawn)["histogram"]
            for drawn in samples
        }
    of_particles = {}
    for count in particles:
        stages = _stage_medians(texton_map, texton_map.histograms, repeats, rng, particles=count)
        of_particles[count] = sum(stages.values())
    return {
        pair: of_samples[pair[0]] + of_particles[pair[1]] for pair in product(samples, particles)
    }


def _stage_medians(
    texton_map: TextonMap, frames: Any, repeats: int, rng: np.random.Generator, **options: Any
) -> dict[str, float]:
    clock = StageClock(texton_map, rng=rng, **options)
    for index in range(repeats + 3):
        clock.step(frames[index % len(frames)])
    # the first three warm up
    return {name: float(np.median(taken[3:])) for name, taken in clock.seconds.items() if taken}


def _amount(samples: int | None) -> float:
    return np.inf if samples is None else samples
