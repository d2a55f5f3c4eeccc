"""Virtual flights that coarse to fine follows: over floors, and kidnapped.

Each function flies one and returns what `trexton.companion.experiments.fine` tabulates.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from time import process_time
from typing import Any

import numpy as np

from trexton.base.streams import stream
from trexton.companion.experiments.declaration import SeedParameters, option
from trexton.companion.experiments.floors import painted_floor
from trexton.companion.experiments.kidnapping import recovered_after
from trexton.evaluation.metrics import euclidean
from trexton.registration import FloorFix, FloorTracker, Trust
from trexton.registration.homography import HomographyLocalizer
from trexton.registration.trust import learn_trust
from trexton.simulator import Effects, Floor, Light, Plan, Simulator, random_waypoints
from trexton.simulator.vehicle import VehicleState

# Roll, pitch and yaw of an autopilot: as measured, with a camera turned in its mount, none.
ATTITUDES = {
    "attitude": "with attitude",
    "tilt_bias": "with a tilt bias",
    "free": "without attitude",
}
SETTLED = 25  # frames, two seconds, in which the vehicle may be found for the first time
GROSS = 0.3  # metres: further off is another place
QUARTERS = 4
SPEED = 0.6  # metres a second
CARRIED = 63  # frames of each kidnapping: two seconds before it, three after
FOUND = 5  # frames in a row
CAMERA = Effects().without("jpeg")  # as the camera delivers; files are for recorded flights
Row = tuple[FloorFix, VehicleState]


@dataclass(frozen=True)
class FollowedParameters(SeedParameters):
    """Those of the virtual flights."""

    floors: int = option(2, "floors flown over, the layouts of the hall in turn", low=1)
    frames: int = option(100, "frames of each flight", low=50)
    training: int = option(60, "frames from which each floor's fits are calibrated", low=50)
    attitude_deg: float = option(0.3, "noise of the autopilot's attitude in degrees", low=0)
    tilt_bias_deg: float = option(
        3.0,
        "degrees that the camera rolled in its mount since the survey, in one of the runs",
        low=0,
    )
    peer_frames: int = option(0, "frames a floor that keypoints and a homography try, too", low=0)


def _frames(room: Simulator, count: int, rng: np.random.Generator) -> Iterator[VehicleState]:
    """The states of a flight between random places."""
    plan = Plan(random_waypoints(room.floor.area, rng))
    for _ in range(count):
        yield room.step(plan.goal(room.state.position))


def follow(
    tracker: FloorTracker, image: np.ndarray, attitude: np.ndarray | None
) -> tuple[FloorFix, float]:
    """What the tracker says of an image, and the processor's seconds."""
    start = process_time()
    fix = tracker.step(image, attitude=attitude)
    return fix, process_time() - start


def measured_attitude(
    attitude: np.ndarray, kind: str, parameters: FollowedParameters, rng: np.random.Generator
) -> np.ndarray | None:
    """``(3,)`` roll, pitch and yaw as the autopilot measures them, radians: see `ATTITUDES`."""
    noise = np.radians(parameters.attitude_deg) * rng.standard_normal(3)
    if kind == "tilt_bias":
        noise[0] += np.radians(parameters.tilt_bias_deg)
    return None if kind == "free" else attitude + noise


def _room(floor: Floor, parameters: FollowedParameters, name: str, index: int) -> Simulator:
    rng = stream(parameters.seed, name, index)
    return Simulator(floor, effects=CAMERA, light=Light.later(), speed=SPEED, rng=rng)


def _floor(index: int) -> tuple[str, Floor]:
    """The layouts of the hall in turn, the repeating ones first, each time from another seed."""
    return painted_floor(index + 2, 100 + index)


def _trackers(
    floor: Floor, room: Simulator, parameters: FollowedParameters, index: int
) -> dict[str, FloorTracker]:
    """Trackers that trust their fits as a flight of their own has taught them."""
    trusts = {}
    for kind in ("attitude", "free"):
        rng = stream(parameters.seed, "training", index)
        taught = _room(floor, parameters, "training room", index)
        tracker = FloorTracker(floor.picture, room.camera, 1.0)
        fixes, truth = [], []
        for state in _frames(taught, parameters.training, rng):
            attitude = measured_attitude(state.attitude, kind, parameters, rng)
            fixes.append(tracker.step(taught.render(), attitude=attitude))
            truth.append(state.position[:2])
        trusts[kind] = learn_trust(fixes, np.array(truth), 1.0, Trust())
    trusts["tilt_bias"] = trusts["attitude"]
    return {
        name: FloorTracker(floor.picture, room.camera, 1.0, trust=trusts[name])
        for name in ATTITUDES
    }


def over_floor(parameters: FollowedParameters, index: int) -> dict[str, Any]:
    """One flight over one floor, attitude known or not; keypoints and a homography at some of its
    frames.
    """
    name, floor = _floor(index)
    room = _room(floor, parameters, "room", index)
    trackers = _trackers(floor, room, parameters, index)
    rng = stream(parameters.seed, "attitude", index)
    every = max(1, parameters.frames // max(1, parameters.peer_frames))
    sift = HomographyLocalizer(floor.picture) if parameters.peer_frames else None
    fixes: dict[str, list[Row]] = {key: [] for key in trackers}
    tried: dict[str, list[float]] = {"sift": []} if sift else {}
    seconds: dict[str, list[float]] = {key: [] for key in (*trackers, *tried)}
    for number, state in enumerate(
        _frames(room, parameters.frames, stream(parameters.seed, "waypoints", index))
    ):
        image = room.render()
        for key, tracker in trackers.items():
            attitude = measured_attitude(state.attitude, key, parameters, rng)
            fix, taken = follow(tracker, image, attitude)
            fixes[key].append((fix, state))
            seconds[key].append(taken)
        if sift and number % every == 0:
            start = process_time()
            found = sift.locate(image).position
            seconds["sift"].append(process_time() - start)
            tried["sift"].append(float(euclidean(found, state.position[:2])))
    return {
        "name": name,
        "rows": {key: _rows(found[SETTLED:]) for key, found in fixes.items()},
        "seconds": seconds,
        "peers": tried,
    }


def _rows(settled: list[Row]) -> np.ndarray:
    """``(N, 4)``: error in metres, squared Mahalanobis distance, lost, quarter of the flight."""
    rows = []
    for number, (fix, state) in enumerate(settled):
        error = fix.position - state.position[:2]
        distance = float(error @ np.linalg.solve(fix.covariance, error))
        rows.append(
            (np.hypot(*error), distance, float(fix.lost), QUARTERS * number // len(settled))
        )
    return np.array(rows)


def kidnapped(parameters: FollowedParameters, index: int) -> dict[str, Any]:
    """One kidnapping: frames until found; which frames are right, which called lost."""
    rng = stream(parameters.seed, "kidnapping", index)
    number = index % parameters.floors
    _, floor = _floor(number)
    room = _room(floor, parameters, "kidnapping room", index)
    tracker = FloorTracker(floor.picture, room.camera, 1.0)
    x_min, x_max, y_min, y_max = floor.area
    error, lost = [], []
    for frame, state in enumerate(_frames(room, CARRIED, rng)):
        if frame == SETTLED:
            place = state.position[:2]
            while euclidean(place, state.position[:2]) < (x_max - x_min) / 2:
                place = rng.uniform((x_min + 0.3, y_min + 0.3), (x_max - 0.3, y_max - 0.3))
            room.vehicle.teleport(place)
            state = room.state
        fix, _ = follow(
            tracker, room.render(), measured_attitude(state.attitude, "attitude", parameters, rng)
        )
        error.append(float(euclidean(fix.position, state.position[:2])))
        lost.append(fix.lost)
    right = np.array(error) < GROSS
    return {
        "floor": number,
        "found": recovered_after(right[SETTLED:], FOUND),
        "right": right,
        "lost": np.array(lost),
    }
