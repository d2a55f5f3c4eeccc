"""Triggered landing in closed loop (paper, Analysis, "Triggered Landing")."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from trexton.base.errors import ParameterError
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.closed_loop import (
    Attempt,
    Lander,
    LandingParameters,
    Mission,
    fly_all,
)
from trexton.companion.experiments.declaration import SURVEYED, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import floor_picture, map_of
from trexton.companion.experiments.floors import lent_floor
from trexton.companion.wording import number, percent
from trexton.evaluation.metrics import bootstrap_interval, success_rate
from trexton.evaluation.runtime import of_frames
from trexton.flights.flight import Flight
from trexton.localization.landing import LandingZone

__all__ = ["EXPERIMENT", "Parameters", "finding", "mission_over", "run", "summarize_attempts"]

PAPER_LANDINGS, PAPER_INSIDE = 6, 4


@dataclass(frozen=True)
class Parameters(MapParameters, LandingParameters):
    """What can be chosen."""

    landings: int = option(16, "attempts, each with another zone, path, wind and start", low=1)
    spread: float = option(0.6, "theta: standard deviation in metres that still lands", low=0)
    consecutive: int = option(1, "estimates in a row that must agree", low=1)

    def __post_init__(self) -> None:
        super().__post_init__()
        LandingZone((0, 0), self.radius, self.spread, self.consecutive)  # refuses the rest


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Land wherever the localizer says that the vehicle is in the zone, over and over.

    Parameters
    ----------
    train, test : Flight
        The map is trained on `train`, and flown over the floor it carries. Of `test` nothing is
        used: the virtual camera takes its place, under the light of an hour later.

    Raises
    ------
    ParameterError
        The flight has no floor or camera, or the area is too small for the zone.
    """
    mission = mission_over(train, parameters, seed=parameters.seed)
    texton_map = map_of(train, parameters)
    zone = partial(
        LandingZone,
        radius=parameters.radius,
        spread=parameters.spread,
        consecutive=parameters.consecutive,
    )
    options = {
        "samples": parameters.samples,
        "particles": parameters.particles,
        "neighbors": parameters.neighbors,
    }
    landers = {"paper": Lander(texton_map, zone, options), "perfect": Lander(None, zone)}
    flown = fly_all(mission, landers, parameters.landings)
    attempts, perfect = flown["paper"], flown["perfect"]
    floor, pictures = floor_picture(train)
    frame_s = np.concatenate([attempt.frame_s for attempt in attempts])
    return parameters.record(
        train,
        values=summarize_attempts(attempts, mission)
        | {"perfect": summarize_attempts(perfect, mission)},
        series=_series(attempts, mission) | {"area_m": train.area} | floor,
        images=pictures,
        timings={"frame_s": of_frames(frame_s)},
    )


def mission_over(
    train: Flight, parameters: LandingParameters, *, seed: int, attitude_deg: float = 0.3
) -> Mission:
    """A mission over the floor that a flight carries, seen by its camera.

    Raises
    ------
    ParameterError
        The flight has no floor or camera, or the area is too small for the zone.
    """
    floor, camera, height = lent_floor(train)
    return Mission(
        floor=floor,
        camera=camera,
        height=height,
        area=train.area,
        places=_zone_places(train, parameters.radius),
        radius=parameters.radius,
        speed=parameters.speed,
        armed_after=parameters.armed_after,
        time_limit=parameters.time_limit,
        seed=seed,
        attitude_deg=attitude_deg,
    )


def _zone_places(train: Flight, radius: float) -> np.ndarray:
    low, high = (
        np.nanmin(train.position, axis=0) + radius,
        np.nanmax(train.position, axis=0) - radius,
    )
    if (low >= high).any():
        raise ParameterError(
            f"a zone of radius {radius} m does not fit into the area that flight {train.name!r} "
            "covers: choose a smaller one"
        )
    return np.array([low, high])


def summarize_attempts(attempts: list[Attempt], mission: Mission) -> dict[str, Any]:
    """Rates with 95 % intervals, distances beyond the circle, waiting times, the yardstick of
    chance.
    """
    done = [attempt for attempt in attempts if attempt.triggered]
    beyond = np.array([_beyond(attempt, attempt.touchdown, mission.radius) for attempt in done])
    outliers = np.sort(beyond[beyond > 0])
    triggered_inside = sum(_beyond(attempt, attempt.truth, mission.radius) <= 0 for attempt in done)
    inside_rate = success_rate(len(done) - len(outliers), len(done))
    first = [
        _beyond(attempt, attempt.touchdown, mission.radius)
        for attempt in attempts[:PAPER_LANDINGS]
        if attempt.triggered
    ]
    surveyed = np.prod(mission.places[1] - mission.places[0] + 2 * mission.radius)
    return {
        "attempts": len(attempts),
        "landings": len(done),
        "never_triggered": len(attempts) - len(done),
        "never_rate": success_rate(len(attempts) - len(done), len(attempts)),
        "inside": len(done) - len(outliers),
        "inside_rate": inside_rate,
        "triggered_inside_rate": success_rate(triggered_inside, len(done)),
        "outliers": len(outliers),
        "outliers_cm": outliers,
        "outlier_mean_cm": _mean(outliers, stream(mission.seed, "intervals")),
        "first_flights": {
            "attempts": len(attempts[:PAPER_LANDINGS]),
            "landings": len(first),
            "inside": sum(value <= 0 for value in first),
            "outliers_cm": [value for value in first if value > 0],
        },
        "paper_or_fewer_chance": _chance(inside_rate),
        "chance_rate": np.pi * mission.radius**2 / surveyed,
        "wait_s": _quantiles([attempt.wait_s for attempt in attempts]),
        "trigger_error_cm": _quantiles(
            [100 * np.hypot(*(attempt.estimate - attempt.truth)) for attempt in done]
        ),
        "lag_cm": _quantiles([_lag(attempt) for attempt in done]),
        "drift_cm": _quantiles(
            [100 * np.hypot(*(attempt.touchdown - attempt.truth)) for attempt in done]
        ),
    }


def _beyond(attempt: Attempt, place: np.ndarray, radius: float) -> float:
    """Distance in cm from the circle to a place outside it; negative inside."""
    return float(100 * (np.hypot(*(place - attempt.zone)) - radius))


def _lag(attempt: Attempt) -> float:
    """How far in cm the estimate trails the vehicle at the trigger, along the way it flies."""
    return float(
        100 * (attempt.truth - attempt.estimate) @ attempt.velocity / np.hypot(*attempt.velocity)
    )


def _mean(values: np.ndarray, rng: np.random.Generator, draws: int = 2000) -> dict[str, Any] | None:
    """Mean and its 95 % bootstrap interval."""
    if not len(values):
        return None
    means = values[rng.integers(len(values), size=(draws, len(values)))].mean(axis=1)
    low, high = bootstrap_interval(means, len(values), block=1)
    return {"value": values.mean(), "low": low, "high": high}


def _quantiles(values: list[float]) -> dict[str, Any] | None:
    return (
        dict(zip(("p10", "median", "p90"), np.percentile(values, (10, 50, 90)), strict=False))
        if values
        else None
    )


def _chance(rate: dict[str, Any] | None) -> float | None:
    """Chance of at most the paper's number inside, in as many landings as the paper's, at our
    rate.
    """
    if rate is None:
        return None
    from scipy.stats import binom

    return float(binom.cdf(PAPER_INSIDE, PAPER_LANDINGS, rate["value"]))


def _series(attempts: list[Attempt], mission: Mission) -> dict[str, Any]:
    """What the figures draw; paths in millimetres' resolution, of the first attempts only."""
    columns = {
        f"{name}_m": np.array([getattr(a, name) for a in attempts])
        for name in ("zone", "estimate", "truth", "touchdown")
    }
    return columns | {
        "triggered": [attempt.triggered for attempt in attempts],
        "wait_s": [attempt.wait_s for attempt in attempts],
        "beyond_cm": [_beyond(attempt, attempt.touchdown, mission.radius) for attempt in attempts],
        "paths_m": [np.round(attempt.path, 3) for attempt in attempts[:PAPER_LANDINGS]],
        "radius_m": mission.radius,
    }


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    values = record.values
    if not values["landings"]:
        return f"None of {values['attempts']} flights triggered a landing."
    rate = values["inside_rate"]
    text = (
        f"{values['inside']} of {values['landings']} landings ended inside the zone "
        f"({percent(rate)}; the paper had {PAPER_INSIDE} of {PAPER_LANDINGS}), "
        f"and {values['never_triggered']} of "
        f"{values['attempts']} flights never triggered"
    )
    perfect = values["perfect"]
    if perfect["landings"]:
        text += (
            f", where the true position would have landed {perfect['inside']} of "
            f"{perfect['landings']}: the estimate was "
            f"{number(values['trigger_error_cm']['median'])} "
            "cm off, in the median, when it gave the word"
        )
    return text + "."


EXPERIMENT = Experiment("Triggered landing", Parameters, run, finding, needs=SURVEYED, cost_s=90)
