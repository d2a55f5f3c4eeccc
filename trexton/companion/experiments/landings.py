"""Landings in closed loop: localizers see what the virtual camera sees, and decide when to land.

All that are compared fly the same flight, frame by frame; each lands a vehicle of its own. Offers
the mission over a flight's floor, `fly_all`, and landings drawn about the centre of their zone.
"""

from collections.abc import Callable, Hashable, Mapping
from copy import deepcopy
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from trexton.base.errors import ParameterError
from trexton.base.streams import stream
from trexton.companion.executor import spread
from trexton.companion.experiments.declaration import SeedParameters, option
from trexton.companion.experiments.floors import lent_floor
from trexton.companion.experiments.metrics import euclidean
from trexton.companion.experiments.style import COLORS
from trexton.flights.aiding import Aiding
from trexton.flights.flight import Flight
from trexton.localization.landing import LandingZone
from trexton.localization.localizer import Estimate, Localizer, TextonMap
from trexton.simulator.floor import Floor, Light
from trexton.simulator.recording import Plan, random_waypoints
from trexton.simulator.sensor import Effects
from trexton.simulator.simulator import PERIOD, Simulator
from trexton.simulator.vehicle import VehicleState
from trexton.vision.camera import Camera

NOWHERE = np.full(2, np.nan)
ATTITUDE = ("roll", "pitch", "yaw")
HEIGHT_NOISE = 0.01  # metres, of the autopilot's height
ATTITUDE_NOISE = np.radians(0.3)  # and of its attitude


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
    """

    floor: Floor
    camera: Camera
    height: float
    area: tuple[float, float, float, float]
    places: np.ndarray
    parameters: LandingParameters
    seed: int


def mission_over(train: Flight, parameters: LandingParameters, *, seed: int) -> Mission:
    """A mission over the floor that a flight carries, seen by its camera.

    Raises
    ------
    ParameterError
        The flight has no floor or camera, or the area is too small for the zone.
    """
    low = np.nanmin(train.position, axis=0) + parameters.radius
    high = np.nanmax(train.position, axis=0) - parameters.radius
    lent = lent_floor(train)
    if (low >= high).any():
        raise ParameterError(
            f"a zone of radius {parameters.radius} m does not fit into the area that flight "
            f"{train.name!r} covers: choose a smaller one"
        )
    return Mission(*lent, train.area, np.array([low, high]), parameters, seed)


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

    @property
    def localizes(self) -> Hashable:
        """The same for all that find the same estimates from the same frames."""
        return id(self.texton_map), self.aiding, *sorted(self.options.items())


@dataclass(frozen=True, eq=False)
class Attempt:
    """One flight towards one zone; positions ``(2,)`` in metres, NaN where the landing was never
    triggered.

    Attributes
    ----------
    wait_s : float
        From the start to the trigger, or to the time limit.
    path : (N, 2) array
        True positions at the frames, until touchdown.
    """

    zone: np.ndarray
    wait_s: float
    estimate: np.ndarray
    truth: np.ndarray
    touchdown: np.ndarray
    path: np.ndarray

    @property
    def triggered(self) -> bool:
        """Whether it landed within the time limit."""
        return bool(np.isfinite(self.truth).all())


def distances(attempts: list[Attempt], place: str) -> np.ndarray:
    """``(N,)`` metres of ``truth`` or ``touchdown`` from the zone's centre; NaN where nothing was
    triggered.
    """
    places = np.array([getattr(attempt, place) for attempt in attempts]).reshape(-1, 2)
    return euclidean(places, np.array([attempt.zone for attempt in attempts]).reshape(-1, 2))


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
        speed=mission.parameters.speed,
        rng=simulator_rng,
    )
    autopilot_rng = stream(mission.seed, "autopilot", number)
    # Each draws the same patches, and those that localize alike have one localizer: what differs
    # between them is not chance.
    localizers = {
        lander.localizes: Localizer(
            lander.texton_map, rng=deepcopy(localizer_rng), **lander.options
        )
        for lander in landers.values()
        if lander.texton_map is not None
    }
    flying = {name: lander.zone(center) for name, lander in landers.items()}
    attempts: dict[str, Attempt] = {}
    state, path = simulator.state, []
    while flying and state.time < mission.parameters.time_limit:
        state = simulator.step(plan.goal(state.position))
        path.append(state.position[:2])
        still = {landers[name].localizes: landers[name].aiding for name in flying}
        frame = simulator.render() if still.keys() & localizers.keys() else None
        measured = _measured(state, autopilot_rng)
        estimates = {
            each: localizers[each].step(frame, aiding=measured.only(aiding), time=state.time)
            if each in localizers
            else _certain(state)
            for each, aiding in still.items()
        }
        for name, zone in list(flying.items()):
            estimate = estimates[landers[name].localizes]
            lands = zone.update(estimate, state.time)
            if lands and state.time > mission.parameters.armed_after:
                attempts[name] = _land(center, estimate, simulator, path)
                del flying[name]
    attempts |= {
        name: Attempt(center, state.time, NOWHERE, NOWHERE, NOWHERE, np.array(path))
        for name in flying
    }
    return {name: attempts[name] for name in landers}


def _measured(state: VehicleState, rng: np.random.Generator) -> Aiding:
    """Attitude and height as an autopilot measures them beside a frame."""
    noise = ATTITUDE_NOISE * rng.standard_normal(3)
    height = float(state.position[2] + HEIGHT_NOISE * rng.standard_normal())
    roll, pitch, yaw = (float(angle) for angle in state.attitude + noise)
    return Aiding(roll=roll, pitch=pitch, yaw=yaw, height=height)


def _land(
    center: np.ndarray, estimate: Estimate, simulator: Simulator, path: list[np.ndarray]
) -> Attempt:
    """Brake and come down, in a vehicle that flew like the others and now parts from them."""
    vehicle, state = deepcopy(simulator.vehicle), simulator.state
    vehicle.land()
    landed, flown = state, list(path)
    while not landed.landed:
        landed = vehicle.advance(PERIOD)
        flown.append(landed.position[:2])
    places = estimate.position, state.position[:2], landed.position[:2]
    return Attempt(center, state.time, *places, np.array(flown))


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


def zone_ring(axes: Axes, center: Any, radius: float, **style: Any) -> None:
    """The edge of a landing zone."""
    axes.add_patch(Circle(center, radius, fill=False, color=COLORS["zone"], lw=2, **style))


def landed(axes: Axes, places: np.ndarray, color: str, label: str, inside: bool = True) -> None:
    """Landings of one outcome: full dots inside their zone, open triangles outside."""
    face, edge = (color, "white") if inside else ("white", color)
    dot: dict[str, Any] = {"facecolors": face, "edgecolors": edge, "label": label}
    dot |= {"marker": "o", "linewidths": 0.6} if inside else {"marker": "^", "linewidths": 1.1}
    axes.scatter(places[:, 0], places[:, 1], s=26, zorder=5, **dot)
