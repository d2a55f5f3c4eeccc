"""Settings for a flight and a computer: the error of each, and what a frame of it costs here.

Errors are those of a replay of the training flight by maps that did not see what is flown
(`trexton.evaluation.held_out`), so no test flight has a say. Costs are measured here.
"""

import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle
from time import perf_counter
from typing import Any

import numpy as np

from trexton.base import defaults
from trexton.base.errors import ParameterError, TrextonError
from trexton.base.files import digest
from trexton.base.progress import say
from trexton.base.streams import stream
from trexton.companion.checks.timing import interleave
from trexton.companion.experiments.evaluation import evenly_spread, frames_of
from trexton.evaluation.held_out import replay, stretches
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.methods import compose
from trexton.localization.training import for_method, train_map, with_choices

METHODS = ("paper", "field")
OF_IMAGES = {
    "textons": (10, 20, 30, 50),
    "cells": (1, 2, 3),
    "samples": (50, 100, 200, 400, 800, 0),
}
OF_NEIGHBORS = {"neighbors": (1, 2, 3, 5, 8, 12), "particles": (50, 100, 200, 400)}
TIMED_S = 0.2  # of frames, whose median counts
_TOLERANCE = 0.02  # differences in error below this are not worth any time

# What is chosen, as on the command line (samples 0: every patch), without what a method or a flight
# without images has no use for.
Setting = dict[str, Any]


def usual(method: str, images: bool) -> Setting:
    """What one flies without a search."""
    setting: Setting = {"method": method}
    if images:
        setting |= {"textons": defaults.TEXTONS, "samples": defaults.SAMPLES}
        setting["cells"] = defaults.USUAL_CELLS.get(method, 1)
    if method != "field":
        setting |= {"neighbors": defaults.NEIGHBORS, "particles": defaults.PARTICLES}
    return setting


def commands(setting: Setting, flight: str, output: str) -> list[str]:
    """The commands that train a map and fly it with a setting."""
    train, fly = flags(setting)
    return [
        f"trexton train {shlex.quote(flight)} -o {shlex.quote(output)} {train}",
        f"trexton onboard {shlex.quote(output)} {fly}".rstrip(),
    ]


def flags(setting: Setting) -> tuple[str, str]:
    """How it is typed after ``trexton train`` and after ``trexton onboard``."""
    train, fly = (
        [f"--{name} {setting[name]}" for name in names if name in setting]
        for names in (("method", "textons", "cells"), ("samples", "particles"))
    )
    if "neighbors" in setting:
        train.append(f"--set measurement.neighbors={setting['neighbors']}")
    return " ".join(train), " ".join(fly)


@dataclass(frozen=True)
class Tried:
    """A setting, its mean error in the replay, and the seconds a frame of it takes here."""

    setting: Setting
    error_m: float
    frame_s: float
    reason: str = ""  # why it could not be flown

    def __str__(self) -> str:
        error = f"{100 * self.error_m:6.1f} cm" if self.error_m < 10 else f"{self.error_m:6.1f} m "
        return f"{error}  {1000 * self.frame_s:7.3f} ms a frame  {' '.join(flags(self.setting))}"


def replayed_errors(texton_map: TextonMap, **how: Any) -> np.ndarray:
    """``(N, 2)`` metres by which left-out stretches of the training flight are misplaced, those
    frames apart in which the filter settles; for `how` see `replay`.
    """
    flown = replay(texton_map, **how)
    return np.array([estimate.position - truth for truth, estimate in flown])


class Bench:
    """Tries settings on a training flight; maps of equal histograms are made once."""

    def __init__(self, flight: Flight, seed: int = 1):
        self.flight, self.seed = flight, seed
        self._maps: dict[tuple[int, int], TextonMap] = {}
        self._frames = frames_of(flight.select(evenly_spread(len(flight), 12)))

    def attempt(self, setting: Setting) -> Tried:
        """Replay the flight with a setting, whose mean error is a function of it alone, and time
        its frames here; raises `TrextonError` where the flight does not do for it.
        """
        flown, samples = self._map(setting), setting.get("samples") or None
        rng = stream(self.seed, f"replay {digest(setting)[:12]}")
        error_m = np.hypot(*replayed_errors(flown, samples=samples, rng=rng).T).mean()
        localizer = Localizer(flown, samples=samples, rng=stream(self.seed, "timed frames"))
        frames = cycle(self._frames)
        (taken,) = interleave(lambda: localizer.step(next(frames)), seconds=TIMED_S, rounds=1)
        return Tried(setting, float(error_m), float(np.median(taken)))

    def _map(self, setting: Setting) -> TextonMap:
        """The map of the whole flight with this setting."""
        key = setting.get("textons", defaults.TEXTONS), setting.get("cells", 1)
        if key not in self._maps:
            chosen = dict(zip(("n_textons", "cells"), key, strict=True))
            rng = stream(self.seed, "training")
            self._maps[key] = train_map(self.flight, rng=rng, neighbors=1, **chosen)
        roles = {"neighbors": "measurement.neighbors", "particles": "filter.particles"}
        choices = {role: setting[name] for name, role in roles.items() if name in setting}
        return with_choices(for_method(self._maps[key], setting["method"]), choices)


def search(
    flight: Flight,
    *,
    methods: Sequence[str] = METHODS,
    trials: int = 40,
    seconds: float = np.inf,
    seed: int = 1,
) -> list[Tried]:
    """Try what is usual with each method, then change one choice at a time and keep what is best.

    Parameters
    ----------
    flight : Flight
        The training part.
    methods : sequence of str
        Each has an equal share of the trials and of the time.
    trials : int
        At most, but one for each method; fewer where no single change is any better.
    seconds : float
        No trial begins later than this.
    seed : int

    Raises
    ------
    MapError
        The flight is too short to leave stretches out.
    ParameterError
        A seed or a method is none, or no setting could be flown.
    """
    # Too short a flight, a method and a seed that are none are refused before any work.
    stretches(flight.time)
    stream(seed, "search")
    for method in methods:
        compose(method)
    bench, began, tried = Bench(flight, seed), perf_counter(), list[Tried]()
    for count, method in enumerate(methods, start=1):
        share = count / len(methods)
        left = max(count, int(trials * share)) - len(tried)
        mine = _one_at_a_time(method, bench, left, began + seconds * share)
        if all(one.frame_s == np.inf for one in mine):
            say(f"{method}: not flown: {mine[0].reason if mine else 'the time was over'}")
        tried += mine
    flown = [one for one in tried if one.frame_s < np.inf]
    if not flown:
        reason = tried[0].reason if tried else "no time"
        raise ParameterError(f"no setting could be flown: {reason}")
    return flown


def _one_at_a_time(method: str, bench: Bench, trials: int, ends: float) -> list[Tried]:
    """Settings of a method that were tried, until no single change is any better."""
    tried: dict[tuple[str, str], Tried] = {}

    def attempt(setting: Setting) -> Tried:
        key = flags(setting)
        if key not in tried:
            try:
                tried[key] = bench.attempt(setting)
            except TrextonError as error:
                tried[key] = Tried(setting, np.inf, np.inf, str(error))
        return tried[key]

    images = bench.flight.has_images
    choices: dict[str, tuple[Any, ...]] = OF_IMAGES if images else {}
    if method != "field":
        choices = OF_NEIGHBORS | choices
    if trials < 1 or perf_counter() >= ends:
        return []
    best, before = attempt(usual(method, images)), None
    while best is not before:
        before = best
        for name, values in choices.items():
            for value in values:
                if len(tried) >= trials or perf_counter() >= ends:
                    return list(tried.values())
                one = attempt(best.setting | {name: value})
                best = min(best, one, key=lambda each: each.error_m)
    return list(tried.values())


def frontier(tried: Sequence[Tried]) -> list[Tried]:
    """Those that no other beats in both error and time, the quickest first."""
    best: list[Tried] = []
    for one in sorted(tried, key=lambda one: (one.frame_s, one.error_m)):
        if not best or one.error_m < best[-1].error_m:
            best.append(one)
    return best


def choose(tried: Sequence[Tried], budget_s: float = np.inf) -> Tried:
    """The cheapest of those within the budget whose error is within two per cent of the best of
    them.

    Raises `ParameterError` where none is within the budget.
    """
    affordable = [one for one in tried if one.frame_s <= budget_s]
    if not affordable:
        cheapest = min(tried, key=lambda one: one.frame_s)
        words = " ".join(flags(cheapest.setting))
        raise ParameterError(
            f"even {words} takes {1000 * cheapest.frame_s:.3g} ms a frame, but "
            f"{1000 * budget_s:.3g} ms are to spend: lower the rate or the headroom"
        )
    enough = min(one.error_m for one in affordable) * (1 + _TOLERANCE)
    return min((one for one in affordable if one.error_m <= enough), key=lambda one: one.frame_s)
