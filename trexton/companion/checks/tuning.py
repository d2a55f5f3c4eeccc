"""Settings for a flight and a computer: what each would err, and what a frame of it costs here.

Errors are those of a replay of the training flight by maps that did not see what is flown
(`trexton.companion.checks.held_out`), so no test flight has a say. Costs are measured here.
"""

from __future__ import annotations

import os
import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from functools import cached_property
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from trexton.base import defaults
from trexton.base.errors import ParameterError, TrextonError
from trexton.base.files import digest
from trexton.base.streams import stream
from trexton.companion.checks.held_out import replay, stretches
from trexton.flights.aiding import Aiding
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.methods import compose
from trexton.localization.roles import make
from trexton.localization.training import for_method, train_map, with_choices, with_parts

if TYPE_CHECKING:
    import optuna

__all__ = ["Bench", "Setting", "Tried", "choose", "frontier", "replayed_errors", "search"]

METHODS = ("paper", "field")
TEXTONS = (10, 20, 30, 50)
CELLS = (1, 2, 3)
SAMPLES = (50, 100, 200, 400, 800, 0)
PARTICLES = (50, 100, 200, 400)
MOST_NEIGHBORS = 15
TIMED = 30  # frames whose median counts, after a few that warm up
_TOLERANCE = 0.02  # differences in error below this are not worth any time


@dataclass(frozen=True)
class Setting:
    """What can be chosen; None where a method or a flight without images has no such choice.

    `samples` 0 looks at every patch.
    """

    method: str = "paper"
    textons: int | None = None
    cells: int | None = None
    samples: int | None = None
    odometry: bool | None = None
    neighbors: int | None = None
    particles: int | None = None

    def __str__(self) -> str:
        words = [f"method {self.method}"]
        if self.cells is not None:
            words += [f"{self.textons} textons", f"{self.cells} x {self.cells} cells"]
            words += [f"{self.samples} samples" if self.samples else "every patch"]
        words += ["visual odometry"] * bool(self.odometry)
        if self.neighbors is not None:
            words += [f"{self.neighbors} neighbour{'s' if self.neighbors > 1 else ''}"]
            words += [f"{self.particles} particles"]
        return ", ".join(words)

    def commands(self, flight: str, output: str) -> list[str]:
        """The commands that train a map and fly it with this setting."""
        train, fly = ["trexton", "train", flight, "-o", output], ["trexton", "onboard", output]
        train += ["--method", self.method]
        train += ["--set", "odometry=visual"] * bool(self.odometry)
        for words, names in (
            (train, ("textons", "cells", "neighbors")),
            (fly, ("samples", "particles")),
        ):
            for name in names:
                if (value := getattr(self, name)) is not None:
                    words += [f"--{name}", str(value)]
        return [shlex.join(words) for words in (train, fly)]


@dataclass(frozen=True)
class Tried:
    """A setting, its mean error in the replay, and the seconds a frame of it takes here."""

    setting: Setting
    error_m: float
    frame_s: float


def replayed_errors(
    texton_map: TextonMap,
    *,
    samples: int | None,
    rng: np.random.Generator,
    told: Sequence[Aiding | None] | None = None,
) -> np.ndarray:
    """``(N, 2)`` metres by which left-out stretches of the training flight are misplaced.

    Frames in which the filter has not yet had its time to settle do not count; for `told` see
    `trexton.companion.checks.held_out.replay`.
    """
    flown = replay(texton_map, samples=samples, rng=rng, aidings=told)
    return np.array([one.error for one in flown])


@dataclass(eq=False)
class Bench:
    """Tries settings on a training flight; maps of equal histograms are made once.

    Parameters
    ----------
    flight : Flight
    seed : int
    """

    flight: Flight
    seed: int = 1

    def __post_init__(self) -> None:
        self._maps: dict[tuple[int | None, int | None], TextonMap] = {}

    def map(self, setting: Setting) -> TextonMap:
        """The map of the whole flight with this setting."""
        key = setting.textons, setting.cells
        if key not in self._maps:
            rng = stream(self.seed, "training")
            chosen = {"n_textons": setting.textons or defaults.TEXTONS, "cells": setting.cells or 1}
            self._maps[key] = train_map(self.flight, rng=rng, neighbors=1, **chosen)  # type: ignore[arg-type]
        choices = {
            "measurement.neighbors": setting.neighbors, "filter.particles": setting.particles
        }  # fmt: skip
        chosen = {name: value for name, value in choices.items() if value is not None}
        texton_map = with_choices(for_method(self._maps[key], setting.method), chosen)
        if not setting.odometry:
            return texton_map
        odometry = {"odometry": self._moving.parts["odometry"]}
        return replace(texton_map, parts=texton_map.parts | odometry)

    def error_m(self, setting: Setting, texton_map: TextonMap) -> float:
        """Mean Euclidean error of the replay, metres."""
        choices = {name: value for name, value in asdict(setting).items() if name != "odometry"}
        rng = stream(self.seed, f"replay {digest(choices)[:12]}")
        told = self._velocities if setting.odometry else None
        errors = replayed_errors(texton_map, samples=setting.samples or None, rng=rng, told=told)
        return float(np.hypot(*errors.T).mean())

    def frame_s(self, setting: Setting, texton_map: TextonMap) -> float:
        """Median seconds of a frame here."""
        rng = stream(self.seed, "timed frames")
        localizer = Localizer(texton_map, samples=setting.samples or None, rng=rng)
        taken = []
        for number in range(TIMED + 3):
            frame = self._frames[number % len(self._frames)]
            start = perf_counter()
            localizer.step(frame)
            taken.append(perf_counter() - start)
        return float(np.median(taken[3:]))

    @cached_property
    def sees_motion(self) -> bool:
        """Whether the flight has what visual odometry takes: images, their camera and heights."""
        try:
            return self._moving is not None
        except TrextonError:
            return False

    @cached_property
    def _moving(self) -> TextonMap:
        """A map with odometry, which is the same whatever the textons."""
        usual = self.map(Setting(**_usual("field", self.flight.has_images)))
        return with_parts(usual, {"odometry": make("odometry", "visual")}, flight=self.flight)

    @cached_property
    def _velocities(self) -> list[Aiding | None]:
        """The velocity of each frame, measured by the camera alone."""
        flight, seeing = self.flight, self._moving
        running = seeing.parts["odometry"].open(seeing.period_s)
        return [
            running.aid(flight.image(row), None, flight.time[row]) for row in range(len(flight))
        ]

    @cached_property
    def _frames(self) -> Sequence[np.ndarray]:
        rows = np.unique(np.linspace(0, len(self.flight) - 1, 12).astype(int))
        if self.flight.has_images:
            return [self.flight.image(row) for row in rows]
        assert self.flight.histograms is not None  # a flight has one or the other
        return list(self.flight.histograms[rows])


def search(
    flight: Flight,
    *,
    methods: Sequence[str] = METHODS,
    trials: int = 40,
    seconds: float | None = None,
    seed: int = 1,
    study: str | os.PathLike[str] | None = None,
) -> list[Tried]:
    """Try settings, more of those that err little or cost little; the methods' own come first.

    Parameters
    ----------
    flight : Flight
        The training part.
    methods : sequence of str
    trials : int
        In all, those of an earlier search in the same `study` included.
    seconds : float, optional
        No trial begins later than this.
    seed : int
    study : path, optional
        A file that keeps every trial, so that a search can be stopped and goes on.

    Raises
    ------
    MapError
        The flight is too short to leave stretches out.
    ParameterError
        A number is out of range, or no setting could be flown.
    """
    import optuna

    if trials < 1 or not (seconds is None or seconds > 0):
        raise ParameterError(
            f"{trials} trials in {seconds} s: expected at least one, and some time"
        )
    # Too short a flight and a seed that is none are refused before any work.
    stretches(flight.time)
    stream(seed, "search")
    for method in methods:
        compose(method)
    optuna.logging.set_verbosity(optuna.logging.CRITICAL)  # a failed trial is reported below
    searched = _study(study, digest(flight.data_hash, list(methods), seed)[:16], seed)
    bench, reasons = Bench(flight, seed), []
    sees_motion = "field" in methods and flight.has_images and bench.sees_motion
    if not searched.trials:
        for method in methods:
            usual = _usual(method, flight.has_images)
            moving = method == "field" and sees_motion
            for choice in [{"odometry": False}, {"odometry": True}] if moving else [{}]:
                searched.enqueue_trial(usual | choice)

    def attempt(trial: optuna.Trial) -> tuple[float, float]:
        setting = _suggested(trial, methods, flight.has_images, sees_motion)
        try:
            texton_map = bench.map(setting)
            return bench.error_m(setting, texton_map), bench.frame_s(setting, texton_map)
        except TrextonError as error:
            reasons.append(str(error))
            raise

    left = trials - sum(trial.state.is_finished() for trial in searched.trials)
    if left > 0:
        searched.optimize(
            attempt, n_trials=left, timeout=seconds, catch=(TrextonError,), gc_after_trial=False
        )
    done = [trial for trial in searched.trials if trial.state == optuna.trial.TrialState.COMPLETE]
    if not done:
        raise ParameterError(f"no setting could be flown: {reasons[0] if reasons else 'no time'}")
    names = {each.name for each in fields(Setting)}
    return [
        Tried(Setting(**{k: v for k, v in trial.params.items() if k in names}), *trial.values)
        for trial in done
    ]


def _study(file: str | os.PathLike[str] | None, name: str, seed: int) -> optuna.Study:
    """The study called `name`, with what is already in the file, an SQLite database."""
    import optuna
    from sqlalchemy.exc import SQLAlchemyError

    try:
        return optuna.create_study(
            directions=["minimize", "minimize"],
            sampler=optuna.samplers.TPESampler(seed=seed),
            storage=None if file is None else f"sqlite:///{os.fspath(file)}",
            study_name=name,
            load_if_exists=True,
        )
    except (SQLAlchemyError, optuna.exceptions.StorageInternalError) as error:
        raise ParameterError(
            f"{file}: no readable study ({type(error).__name__}): name another file"
        ) from None


def _suggested(
    trial: optuna.Trial, methods: Sequence[str], images: bool, sees_motion: bool
) -> Setting:
    choices: dict[str, Any] = {"method": trial.suggest_categorical("method", methods)}
    if images:
        for name, values in (("textons", TEXTONS), ("cells", CELLS), ("samples", SAMPLES)):
            choices[name] = trial.suggest_categorical(name, values)
    if choices["method"] == "field":
        if sees_motion:
            choices["odometry"] = trial.suggest_categorical("odometry", (False, True))
    else:
        choices["neighbors"] = trial.suggest_int("neighbors", 1, MOST_NEIGHBORS)
        choices["particles"] = trial.suggest_categorical("particles", PARTICLES)
    return Setting(**choices)


def _usual(method: str, images: bool) -> dict[str, Any]:
    """What one flies without a search."""
    usual: dict[str, Any] = {"method": method}
    if images:
        usual |= {"textons": defaults.TEXTONS, "samples": defaults.SAMPLES}
        usual["cells"] = defaults.USUAL_CELLS.get(method, 1)
    if method != "field":
        usual |= {"neighbors": defaults.NEIGHBORS, "particles": defaults.PARTICLES}
    return usual


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

    Raises
    ------
    ParameterError
        None is within the budget.
    """
    affordable = [one for one in tried if one.frame_s <= budget_s]
    if not affordable:
        cheapest = min(tried, key=lambda one: one.frame_s)
        raise ParameterError(
            f"even {cheapest.setting} takes {1000 * cheapest.frame_s:.3g} ms a frame, but "
            f"{1000 * budget_s:.3g} ms are to spend: lower the rate or the headroom"
        )
    enough = min(one.error_m for one in affordable) * (1 + _TOLERANCE)
    return min((one for one in affordable if one.error_m <= enough), key=lambda one: one.frame_s)
