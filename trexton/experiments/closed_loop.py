"""The closed loop of the triggered landings: the localizer sees what the virtual camera sees, and
decides.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from trexton.camera import Camera
from trexton.executor import spread
from trexton.landing import LandingZone, TouchdownZone
from trexton.localizer import Estimate, Localizer, TextonMap
from trexton.simulator import (
    Effects,
    Floor,
    Light,
    Plan,
    Simulator,
    VehicleState,
    random_waypoints,
)
from trexton.streams import stream

__all__ = ["Attempt", "Mission", "fly_all", "fly_attempt"]

NOWHERE = np.full(2, np.nan)


@dataclass(frozen=True, eq=False)
class Mission:
    """What all attempts have in common.

    Attributes
    ----------
    places : (2, 2) array
        Lowest and highest x, y of a zone's centre: the circle stays within the surveyed area.
    options : dict
        Of the localizer.
    trigger : str
        A name of `trexton.landing.TRIGGERS`.
    """

    texton_map: TextonMap
    floor: Floor
    camera: Camera
    height: float
    speed: float
    places: np.ndarray
    radius: float
    spread: float
    consecutive: int
    armed_after: float
    time_limit: float
    options: dict[str, Any]
    seed: int
    trigger: str = "inside"

    def zone(self, center: np.ndarray) -> LandingZone:
        """The zone around a centre, with the mission's trigger."""
        if self.trigger == "touchdown":
            return TouchdownZone(
                center, self.radius, consecutive=self.consecutive, time_limit=self.time_limit
            )
        return LandingZone(center, self.radius, self.spread, self.consecutive)


@dataclass(frozen=True, eq=False)
class Attempt:
    """One flight towards one zone; positions ``(2,)`` in metres, NaN where the landing was never
    triggered.

    Attributes
    ----------
    velocity : (2,) array
        True velocity at the trigger, metres a second.
    path : (N, 2) array
        True positions at the frames, until touchdown.
    wait_s : float
        From the start to the trigger, or to the time limit.
    frame_s : (M,) array
        Wall-clock time of rendering and localizing each frame.
    """

    zone: np.ndarray
    triggered: bool
    wait_s: float
    estimate: np.ndarray
    truth: np.ndarray
    velocity: np.ndarray
    touchdown: np.ndarray
    path: np.ndarray
    frame_s: np.ndarray


def fly_attempt(mission: Mission, number: int, perfect: bool = False) -> Attempt:
    """Fly at random until the trigger fires, then land; attempt `number` has a generator of its
    own.

    `perfect` puts the true position in the localizer's place: what remains is what landing itself
    costs.
    """
    rng = stream(mission.seed, "landings", number)
    zone_rng, plan_rng, simulator_rng, localizer_rng = rng.spawn(4)
    zone = mission.zone(zone_rng.uniform(*mission.places))
    plan = Plan(random_waypoints(mission.texton_map.area, plan_rng))
    # The camera hands its frames over as they are: nothing is compressed on board.
    simulator = Simulator(
        mission.floor,
        camera=mission.camera,
        effects=Effects().without("jpeg"),
        light=Light.later(),
        start=plan.start,
        height=mission.height,
        speed=mission.speed,
        rng=simulator_rng,
    )
    localizer = (
        None if perfect else Localizer(mission.texton_map, rng=localizer_rng, **mission.options)
    )
    state, path, frame_s, triggered = simulator.state, [], [], False
    while not triggered and state.time < mission.time_limit:
        state = simulator.step(plan.goal(state.position))
        start = perf_counter()
        estimate = localizer.step(simulator.render()) if localizer else _certain(state)
        frame_s.append(perf_counter() - start)
        path.append(state.position[:2])
        triggered = zone.update(estimate, state.time) and state.time > mission.armed_after
    wait_s, guess = state.time, estimate.position if triggered else NOWHERE
    truth, velocity = (state.position[:2], state.velocity[:2]) if triggered else (NOWHERE, NOWHERE)
    if triggered:
        simulator.vehicle.land()
    while triggered and not state.landed:
        state = simulator.step()
        path.append(state.position[:2])
    touchdown = state.position[:2] if triggered else NOWHERE
    flown = np.array(path), np.array(frame_s)
    return Attempt(zone.center, triggered, wait_s, guess, truth, velocity, touchdown, *flown)


def _certain(state: VehicleState) -> Estimate:
    """An estimate without any doubt."""
    place, velocity = state.position[:2], state.velocity[:2]
    return Estimate(place, np.zeros((2, 2)), velocity=velocity, joint=np.zeros((4, 4)))


def fly_all(mission: Mission, landings: int, perfect: bool = False) -> list[Attempt]:
    """All attempts in order, wherever there is room for them."""
    fly = partial(fly_attempt, mission, perfect=perfect)
    return spread(fly, range(landings), "landings")
