"""What both estimators make of a flight that is sent to them, beside each image sent once at its
capture: the whole way from frames to messages to the fused position.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from onboard_autopilot import AUTOPILOT_HEARTBEAT, attitude, from_autopilot
from onboard_consumers import Delayed, ekf2, ekf3, readings
from scipy.interpolate import CubicSpline

from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer, TextonMap
from trexton.onboard.fix import Continuity, Fix, LocalFrame
from trexton.onboard.mavlink.listener import Listener
from trexton.onboard.mavlink.messages import PROFILES
from trexton.onboard.mavlink.speaker import Speaker
from trexton.simulator.floor import Floor
from trexton.simulator.recording import record_flight

SURVEY, FRAMES = 800, 415  # frames of the flights over a painted floor
DELAYS_S = (0.0, 0.06, 0.15)  # of the camera
BOUNDS_M = {"px4": 0.01, "ardupilot": 0.1}  # least deviations that the page gives for `fine`
TICK = 0.01  # seconds
G = 9.81
SETTLED_S = 4.0  # after the first message that is fused


def estimator(profile: str, floor: float | None = None) -> Delayed:
    """The consumer behind a profile, with another lower bound of the standard deviation, metres."""
    if profile == "px4":
        made = Delayed(ekf2())
    else:
        made = Delayed(ekf3(), 0.22, 0.02, start_s=0.5, stop_s=0.5)
    made.consumer.floor = floor or made.consumer.floor
    return made


def flights(folder: Path, layout: str, seed: int, frames: int = FRAMES) -> tuple[Flight, Flight]:
    """A survey of a painted floor, and a later flight over it."""
    floor = Floor.painted(layout, seed)
    survey = record_flight(folder / "survey", floor=floor, seed=seed, frames=SURVEY)
    pattern = "waypoints"
    return survey, record_flight(
        folder / "test", pattern=pattern, floor=floor, seed=seed + 1, frames=frames
    )


def estimated(texton_map: TextonMap, test: Flight, seed: int = 1) -> list[Fix]:
    """Of each frame what the localizer says, flown as it is recorded."""
    localizer = Localizer(texton_map, rng=np.random.default_rng(seed))
    made = []
    for row, time in enumerate(test.time.tolist()):
        if test.has_images:
            aiding = test.aiding(row).without_heading()
            estimate = localizer.step(test.image(row), aiding=aiding, time=time)
        else:
            estimate = localizer.step(test.histograms[row], time=time)
        made.append(Fix.of(estimate, time, row, texton_map.area, texton_map.period_s))
    return made


def held_back(made: list[Fix], texton_map: TextonMap) -> list[Fix]:
    """What the loop hands to its sinks of each: a new place counts as lost until it has lasted."""
    localizer = Localizer(texton_map, rng=np.random.default_rng(0))
    continuity = Continuity(localizer.parts["motion"].growth, texton_map.period_s)
    return [continuity.mark(fix) for fix in made]


def kidnapped(test: Flight, every_s: float) -> tuple[Flight, np.ndarray]:
    """The flight cut every so many seconds, each piece followed by the one that begins farthest
    from its end; and of each frame the seconds since its piece began."""
    period_s = float(np.median(np.diff(test.time)))
    length = round(every_s / period_s)
    waiting = [np.arange(len(test))[at : at + length] for at in range(0, len(test), length)]
    pieces = [waiting.pop(0)]
    while waiting:
        steps = test.position[[each[0] for each in waiting]] - test.position[pieces[-1][-1]]
        pieces.append(waiting.pop(int(np.hypot(*steps.T).argmax())))
    order = np.concatenate(pieces)
    columns = {"position": test.position[order], "height": test.height[order]}
    cut = replace(test, frames=test.frames.at(order), attitude=test.attitude[order], **columns)
    return cut, period_s * np.concatenate([np.arange(len(each)) for each in pieces])


@dataclass
class Fused:
    """Mean error in metres, share of ticks with the truth in the 90 % region, messages dropped."""

    error_m: float
    inside: float
    dropped: float


class Vehicle:
    """One that flew a known track, with an accelerometer whose level wanders by a seventh of a
    degree."""

    def __init__(self, test: Flight, seed: int = 3):
        rng = np.random.default_rng(seed)
        self.start = float(test.time[0])
        self.ticks = np.arange(self.start, float(test.time[-1]) + 0.6, TICK)
        within = np.clip(self.ticks, test.time[0], test.time[-1])
        self.truth = CubicSpline(test.time, np.asarray(test.position))(within)
        tilt = np.zeros((len(self.ticks), 2))
        for step in range(1, len(tilt)):
            tilt[step] = 0.999 * tilt[step - 1] + rng.normal(0, 1e-4, 2)
        self.pushes = readings(self.truth, TICK, rng) + G * tilt

    def fused(self, autopilot: Delayed, arrivals) -> Fused:
        """`arrivals` gives the messages that have come at a tick."""
        errors, inside, began = [], [], np.inf
        shift = round(autopilot.horizon_s / TICK)
        for number, now in enumerate(self.ticks):
            for stamp, position, variances in arrivals(now):
                autopilot.receive(stamp, position, variances)
            autopilot.tick(now, self.pushes[number], TICK)
            if autopilot.consumer.state is not None:
                began = min(began, now)
                if now - began > SETTLED_S:
                    truth = self.truth[number - shift + 1]
                    errors.append(np.hypot(*(autopilot.consumer.state[:2] - truth)))
                    inside.append(autopilot.consumer.inside(truth))
        return Fused(float(np.mean(errors)), float(np.mean(inside)), len(autopilot.dropped))


def once(made: list[Fix], delay: float):
    """Each image once, at its capture: the best there is to be sent."""
    waiting = [fix for fix in made if fix.usable and fix.observed]

    def arrivals(now):
        while waiting and waiting[0].time + delay <= now:
            fusion, time = waiting[0].fusion, waiting.pop(0).time
            bound = abs(fusion.covariance[0, 1])
            yield time, fusion.position, np.diagonal(fusion.covariance) + bound

    return arrivals


def sent(made: list[Fix], delay: float, profile: str, texton_map: TextonMap):
    """What goes over the wire of the same fixes."""
    growth = Localizer(texton_map, rng=np.random.default_rng(0)).parts["motion"].growth(1.0)
    talk = Speaker(PROFILES[profile](LocalFrame(), texton_map.area), growth, Listener())
    talk.listener.hear(from_autopilot(AUTOPILOT_HEARTBEAT), made[0].time)
    waiting = list(made)

    def arrivals(now):
        if round(now / TICK) % 5 == 0:
            talk.listener.hear(from_autopilot(attitude(now)), now)
        while waiting and waiting[0].time + delay <= now:
            talk.tell(waiting.pop(0), now)
        for message in talk.due(now):
            kind = message.get_type()
            if kind == "VISION_POSITION_ESTIMATE" or (kind == "ODOMETRY" and message.quality > 0):
                stamp = getattr(message, "usec", None) or message.time_usec
                matrix = getattr(message, "covariance", None) or message.pose_covariance
                where = np.array([message.y, message.x])
                yield 1e-6 * stamp, where, np.array([matrix[6], matrix[0]])

    return arrivals


def proof(
    made: list[Fix], texton_map: TextonMap, test: Flight, profile: str, delay: float, floor=None
) -> tuple[Fused, Fused]:
    """Of what is sent, and of each image once; means over three accelerometers."""
    both = []
    for seed in (3, 4, 5):
        vehicle = Vehicle(test, seed)
        best = vehicle.fused(estimator(profile, floor), once(made, delay))
        wire = sent(made, delay, profile, texton_map)
        both.append((vehicle.fused(estimator(profile, floor), wire), best))
    return tuple(
        Fused(*np.mean([(x.error_m, x.inside, x.dropped) for x in each], axis=0).tolist())
        for each in zip(*both, strict=True)
    )


def proofs(
    texton_map: TextonMap, test: Flight, method: str
) -> Iterator[tuple[str, float, Fused, Fused]]:
    """Behind both autopilots and after every delay of the camera, of the same fixes."""
    made = held_back(estimated(texton_map, test), texton_map)
    for profile, bound in BOUNDS_M.items():
        floor = bound if method == "fine" else None
        for delay in DELAYS_S:
            yield profile, delay, *proof(made, texton_map, test, profile, delay, floor)
