"""The closed loop of the triggered landings: localizers see what the virtual camera sees, and
decide.

All that are compared fly the same flight, frame by frame; each lands a vehicle of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import partial
from time import perf_counter
from typing import Any

import numpy as np

from trexton.base.errors import ParameterError
from trexton.base.streams import stream
from trexton.companion.executor import spread
from trexton.companion.experiments.declaration import SeedParameters, option
from trexton.flights.aiding import Aiding
from trexton.localization.landing import LandingZone
from trexton.localization.localizer import Estimate, Localizer, TextonMap
from trexton.simulator import (
    PERIOD,
    Effects,
    Floor,
    Light,
    Plan,
    Simulator,
    VehicleState,
    random_waypoints,
)
from trexton.vision.camera import Camera

NOWHERE = np.full(2, np.nan)
ATTITUDE = ("roll", "pitch", "yaw")
HEIGHT_NOISE = 0.01  # metres, of the autopilot's height


@dataclass(frozen=True)
class LandingParameters(SeedParameters):
    """Those of flights that end in a landing."""

    radius: float = option(0.6, "r of the zone in metres", low=0.01)
    armed_after: float = option(5.0, "seconds of flight before a trigger counts", low=0)
    time_limit: float = option(
        60.0, "seconds after which a landing counts as never triggered", low=0
    )
    speed: float = option(0.6, "of the vehicle, metres a second", low=0.01)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.armed_after >= self.time_limit:
            raise ParameterError(
                f"armed after {self.armed_after} s of at most {self.time_limit} s: "
                "expected a limit after the zone is armed"
            )


@dataclass(frozen=True, eq=False)
class Mission:
    """What all attempts have in common.

    Attributes
    ----------
    places : (2, 2) array
        Lowest and highest x, y of a zone's centre: the circle stays within the surveyed area.
    attitude_deg : float
        Noise of the attitude that the autopilot measures.
    """

    floor: Floor
    camera: Camera
    height: float
    speed: float
    area: tuple[float, float, float, float]
    places: np.ndarray
    radius: float
    armed_after: float
    time_limit: float
    seed: int
    attitude_deg: float = 0.3


@dataclass(frozen=True, eq=False)
class Lander:
    """One that decides when to land.

    Attributes
    ----------
    texton_map : TextonMap or None
        None: it knows the truth, and what remains is what landing itself costs.
    zone : callable
        Gives the zone and its trigger around a centre.
    options : dict
        Of the localizer.
    aiding : tuple of str
        What the autopilot measures beside a frame: names of `Aiding`, of attitude and height.
    """

    texton_map: TextonMap | None
    zone: Callable[[np.ndarray], LandingZone]
    options: dict[str, Any] = field(default_factory=dict)
    aiding: tuple[str, ...] = ()


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
    passed : bool
        Whether the flight came over the zone while a trigger counts, had nobody landed.
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
    passed: bool = False


def fly_together(
    mission: Mission, landers: Mapping[str, Lander], number: int
) -> dict[str, Attempt]:
    """Fly at random until each has triggered its landing; flight `number` has a generator of its
    own.
    """
    rng = stream(mission.seed, "landings", number)
    zone_rng, plan_rng, simulator_rng, localizer_rng = rng.spawn(4)
    center = zone_rng.uniform(*mission.places)
    plan = Plan(random_waypoints(mission.area, plan_rng))
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
    autopilot = _Autopilot(mission, stream(mission.seed, "autopilot", number))
    # Each draws the same patches: what differs between them is not chance.
    flying = {
        name: _Flying(lander, center, deepcopy(localizer_rng)) for name, lander in landers.items()
    }
    attempts: dict[str, Attempt] = {}
    state, path, passed = simulator.state, [], False
    while state.time < mission.time_limit:
        state = simulator.step(plan.goal(state.position))
        path.append(state.position[:2])
        armed = state.time > mission.armed_after
        passed |= armed and bool(np.hypot(*(path[-1] - center)) < mission.radius)
        if not flying:
            continue
        start = perf_counter()
        imaging = any(each.localizer for each in flying.values())
        frame = simulator.render() if imaging else None
        measured = autopilot.measure(state)
        rendered_s = perf_counter() - start
        for name, each in list(flying.items()):
            if each.decides(frame, measured, state, rendered_s) and armed:
                attempts[name] = each.land(simulator, path)
                del flying[name]
    attempts |= {name: each.give_up(state, path) for name, each in flying.items()}
    return {name: replace(attempts[name], passed=passed) for name in landers}


class _Autopilot:
    """What is measured beside a frame."""

    def __init__(self, mission: Mission, rng: np.random.Generator):
        self._rng, self._sigma = rng, np.radians(mission.attitude_deg)

    def measure(self, state: VehicleState) -> Aiding:
        """Attitude and height."""
        attitude = state.attitude + self._sigma * self._rng.standard_normal(3)
        height = float(state.position[2] + HEIGHT_NOISE * self._rng.standard_normal())
        roll, pitch, yaw = (float(angle) for angle in attitude)
        return Aiding(roll=roll, pitch=pitch, yaw=yaw, height=height)


class _Flying:
    """A lander in flight."""

    def __init__(self, lander: Lander, center: np.ndarray, rng: np.random.Generator):
        self.zone, self.aiding = lander.zone(center), lander.aiding
        self.localizer = (
            None
            if lander.texton_map is None
            else Localizer(lander.texton_map, rng=rng, **lander.options)
        )
        self._frame_s: list[float] = []

    def decides(
        self,
        frame: np.ndarray | None,
        measured: Aiding,
        state: VehicleState,
        rendered_s: float,
    ) -> bool:
        """Whether it would land after this frame."""
        start = perf_counter()
        self._estimate = (
            self.localizer.step(frame, aiding=measured.only(self.aiding), time=state.time)
            if self.localizer
            else _certain(state)
        )
        self._frame_s.append(rendered_s + perf_counter() - start)
        return self.zone.update(self._estimate, state.time)

    def land(self, simulator: Simulator, path: list[np.ndarray]) -> Attempt:
        """Brake and come down, in a vehicle that flew like the others and now parts from them."""
        vehicle, state = deepcopy(simulator.vehicle), simulator.state
        vehicle.land()
        landed, flown = state, list(path)
        while not landed.landed:
            landed = vehicle.advance(PERIOD)
            flown.append(landed.position[:2])
        return Attempt(
            self.zone.center, True, state.time, self._estimate.position, state.position[:2],
            state.velocity[:2], landed.position[:2], np.array(flown), np.array(self._frame_s),
        )  # fmt: skip

    def give_up(self, state: VehicleState, path: list[np.ndarray]) -> Attempt:
        """The attempt of one that never triggered."""
        nowhere = (NOWHERE,) * 4
        flown = np.array(path), np.array(self._frame_s)
        return Attempt(self.zone.center, False, state.time, *nowhere, *flown)


def _certain(state: VehicleState) -> Estimate:
    """An estimate without uncertainty."""
    place, velocity = state.position[:2], state.velocity[:2]
    return Estimate(place, np.zeros((2, 2)), velocity=velocity, joint=np.zeros((4, 4)))


def fly_all(
    mission: Mission, landers: Mapping[str, Lander], flights: int
) -> dict[str, list[Attempt]]:
    """The attempts of each lander in order, flown wherever there is room for them."""
    flown = spread(partial(fly_together, mission, landers), range(flights), "landings")
    return {name: [attempts[name] for attempts in flown] for name in landers}
