"""Coarse to fine: textons say where about, the image says exactly where.

Beyond the paper. Virtual flights over floors on which nothing was tuned, repeating ones among them;
the same camera carried away and put down elsewhere; light that drifts; keypoint methods beside it.
Times are those of the processor, whatever else it does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from time import process_time
from typing import Any

import numpy as np

from trexton import wording
from trexton.camera import MapImage
from trexton.executor import spread
from trexton.experiments.declaration import SeedParameters, option
from trexton.experiments.floors import painted_floor
from trexton.experiments.peers import PEERS, make_peer
from trexton.experiments.stitched import stitched_map
from trexton.flights.flight import Flight
from trexton.metrics import euclidean, mean_over_groups, mean_with_interval, success_rate
from trexton.records import Record
from trexton.registration import FloorFix, FloorTracker, Trust
from trexton.registration.calibration import learn_trust
from trexton.simulator import Effects, Floor, Light, Plan, Simulator, random_waypoints
from trexton.simulator.vehicle import VehicleState
from trexton.streams import stream

__all__ = ["Parameters", "finding", "kidnapping_summary", "over_floors", "run"]

# The autopilot tells roll, pitch and yaw; tells them though the camera looks askew; tells nothing.
KNOWN = {"attitude": "with attitude", "askew": "with attitude askew", "free": "without attitude"}
SETTLED = 25  # frames, two seconds, in which the vehicle may be found for the first time
GROSS = 0.3  # metres: further off is another place
REGION = 4.605  # squared Mahalanobis distance within which 90 % should lie
QUARTERS = 4
SPEED = 0.6  # metres a second
CARRIED = 63  # frames of each kidnapping: two seconds before it, three after
FOUND = 5  # frames in a row
CAMERA = Effects().without("jpeg")  # as the camera delivers; files are for recorded flights
Row = tuple[FloorFix, VehicleState, float]


@dataclass(frozen=True)
class Parameters(SeedParameters):
    """What can be chosen."""

    floors: int = option(2, "floors flown over, the layouts of the hall in turn", low=1)
    frames: int = option(100, "frames of each flight", low=50)
    training: int = option(60, "frames from which each floor's fits are calibrated", low=50)
    attitude_deg: float = option(0.3, "noise of the autopilot's attitude in degrees", low=0)
    askew_deg: float = option(
        3.0,
        "degrees that the camera rolled in its mount since the survey, in one of the runs",
        low=0,
    )
    kidnappings: int = option(3, "times that the vehicle is carried away", low=1)
    drifts: int = option(2, "strengths of the light's drift, none and 5 % first", low=2, high=4)
    peer_frames: int = option(0, "frames a floor that keypoint methods try, too", low=0)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Fly coarse to fine over the test flight, over virtual floors, kidnapped, in drifting light.

    Parameters
    ----------
    train, test : Flight
        With images, a picture of the floor, and a camera.
    """
    given, given_series, seconds = _recorded(train, test, parameters)
    trials = spread(partial(_over, parameters), range(parameters.floors), "floors")
    carried = spread(partial(_carried, parameters), range(parameters.kidnappings), "kidnappings")
    strengths = np.array([0.0, 0.05, 0.1, 0.02])[: parameters.drifts]
    light = spread(partial(_in_light, parameters), strengths.tolist(), "light")
    pooled = {
        name: _summary(np.concatenate([trial["rows"][name] for trial in trials])) for name in KNOWN
    }
    drift = {f"{100 * share:.0f}": mean for share, mean in zip(strengths, light, strict=True)}
    return parameters.record(
        train, test,
        values={
            "flight": given,
            "floors": {trial["name"]: trial["values"] for trial in trials},
            "all": pooled,
            "peers": _peers(trials),
            "kidnapped": kidnapping_summary(carried),
            "light_cm": drift,
            "light_ratio": light[1] / light[0],
        },
        series=given_series | {
            "errors_cm": {name: _quantiles(trials, name) for name in KNOWN},
            "coverage": {name: _coverage(trials, name) for name in KNOWN},
        },
        timings={name: _times(np.concatenate([trial["seconds"][name] for trial in trials]))
                 for name in KNOWN} | {"flight": seconds} | _peer_times(trials),
    )  # fmt: skip


# -- flights --------------------------------------------------------------------------------------


def _frames(room: Simulator, count: int, rng: np.random.Generator) -> Iterator[VehicleState]:
    """The states of a flight between random places."""
    plan = Plan(random_waypoints(room.floor.area, rng))
    for _ in range(count):
        yield room.step(plan.goal(room.state.position))


def _follow(
    tracker: FloorTracker, image: np.ndarray, attitude: np.ndarray | None
) -> tuple[FloorFix, float]:
    start = process_time()
    fix = tracker.step(image, attitude=attitude)
    return fix, process_time() - start


def _told(
    attitude: np.ndarray, known: str, parameters: Parameters, rng: np.random.Generator
) -> np.ndarray | None:
    noise = np.radians(parameters.attitude_deg) * rng.standard_normal(3)
    if known == "askew":
        noise[0] += np.radians(parameters.askew_deg)
    return None if known == "free" else attitude + noise


def _room(
    floor: Floor, parameters: Parameters, name: str, index: int, effects: Effects = CAMERA
) -> Simulator:
    rng = stream(parameters.seed, name, index)
    return Simulator(floor, effects=effects, light=Light.later(), speed=SPEED, rng=rng)


def _floor(index: int) -> tuple[str, Floor]:
    """The layouts of the hall in turn, the repeating ones first, each time from another seed."""
    return painted_floor(index + 2, 100 + index)


def _trackers(
    floor: Floor, room: Simulator, parameters: Parameters, index: int
) -> dict[str, FloorTracker]:
    """Trackers that trust their fits as a flight of their own has taught them."""
    trusts = {}
    for known in ("attitude", "free"):
        rng = stream(parameters.seed, "training", index)
        taught = _room(floor, parameters, "training room", index)
        tracker = FloorTracker(floor.picture, room.camera, 1.0)
        fixes, truth = [], []
        for state in _frames(taught, parameters.training, rng):
            attitude = _told(state.attitude, known, parameters, rng)
            fixes.append(tracker.step(taught.render(), attitude=attitude))
            truth.append(state.position[:2])
        trusts[known] = learn_trust(fixes, np.array(truth), 1.0, Trust())
    trusts["askew"] = trusts["attitude"]
    return {
        name: FloorTracker(floor.picture, room.camera, 1.0, trust=trusts[name]) for name in KNOWN
    }


def _over(parameters: Parameters, index: int) -> dict[str, Any]:
    """One flight over one floor, attitude known or not, keypoint methods at some frames."""
    name, floor = _floor(index)
    room = _room(floor, parameters, "room", index)
    trackers = _trackers(floor, room, parameters, index)
    rng = stream(parameters.seed, "attitude", index)
    every = max(1, parameters.frames // max(1, parameters.peer_frames))
    peers = {key: make_peer(key, floor.picture) for key in PEERS if parameters.peer_frames}
    fixes: dict[str, list[Row]] = {key: [] for key in trackers}
    tried: dict[str, list[tuple[float, float]]] = {key: [] for key in peers}
    for number, state in enumerate(
        _frames(room, parameters.frames, stream(parameters.seed, "waypoints", index))
    ):
        image = room.render()
        for key, tracker in trackers.items():
            attitude = _told(state.attitude, key, parameters, rng)
            fix, seconds = _follow(tracker, image, attitude)
            fixes[key].append((fix, state, seconds))
        if number % every == 0:
            for key, peer in peers.items():
                start = process_time()
                found = peer.locate(image).position
                seconds = process_time() - start
                tried[key].append((float(euclidean(found, state.position[:2])), seconds))
    rows = {key: _rows(found) for key, found in fixes.items()}
    return {
        "name": name,
        "rows": rows,
        "values": {key: _summary(row) for key, row in rows.items()},
        "seconds": {key: np.array([row[2] for row in found]) for key, found in fixes.items()},
        "peers": {key: np.array(found) for key, found in tried.items()},
    }


def _rows(found: list[Row]) -> np.ndarray:
    """``(N, 4)``: error in metres, squared Mahalanobis distance, lost, quarter of the flight."""
    rows, settled = [], found[SETTLED:]
    for number, (fix, state, _) in enumerate(settled):
        error = fix.position - state.position[:2]
        distance = float(error @ np.linalg.solve(fix.covariance, error))
        rows.append(
            (np.hypot(*error), distance, float(fix.lost), QUARTERS * number // len(settled))
        )
    return np.array(rows)


def _summary(rows: np.ndarray) -> dict[str, Any]:
    error, distance, lost, quarter = rows.T
    inside = distance < REGION
    return {
        "frames": len(rows),
        "mean_cm": 100 * error.mean(),
        "median_cm": 100 * np.median(error),
        "p95_cm": 100 * np.percentile(error, 95),
        "max_cm": 100 * error.max(),
        "gross": int((error > GROSS).sum()),
        "lost": lost.mean(),
        "region_90": inside.mean(),
        "region_90_quarters": [inside[quarter == part].mean() for part in range(QUARTERS)],
        "nees": distance.mean() / 2,
    }


def _quantiles(trials: list[dict[str, Any]], name: str) -> dict[str, Any]:
    shares = np.linspace(0, 100, 101)
    error = np.concatenate([trial["rows"][name][:, 0] for trial in trials])
    return {"share": shares, "error": 100 * np.percentile(error, shares)}


def _coverage(trials: list[dict[str, Any]], name: str) -> dict[str, Any]:
    """Claimed share of regions, and the share of them that hold the truth."""
    claimed = np.linspace(0.05, 0.95, 19)
    distance = np.concatenate([trial["rows"][name][:, 1] for trial in trials])
    bounds = -2 * np.log1p(-claimed)  # chi-squared in the plane
    return {"claimed": claimed, "held": [(distance < bound).mean() for bound in bounds]}


def _times(seconds: np.ndarray) -> dict[str, float]:
    return {"median_s": float(np.median(seconds)), "p99_s": float(np.percentile(seconds, 99))}


# -- the recorded flight --------------------------------------------------------------------------


def _recorded(
    train: Flight, test: Flight, parameters: Parameters
) -> tuple[dict[str, Any], dict[str, Any], dict[str, float]]:
    """The test flight on the surveyed and on the stitched map."""
    assert test.floor is not None and test.camera is not None
    assert test.height is not None and test.attitude is not None
    height = float(np.median(test.height))
    pictures: dict[str, MapImage] = {"surveyed": test.floor, "stitched": stitched_map(train).map}
    trackers = {
        (where, name): FloorTracker(picture, test.camera, height)
        for where, picture in pictures.items()
        for name in KNOWN
    }
    rng = stream(parameters.seed, "recorded")
    track: dict[tuple[str, str], list[np.ndarray]] = {key: [] for key in trackers}
    seconds = []
    for row, image in enumerate(test.images()):
        for key, tracker in trackers.items():
            attitude = _told(test.attitude[row], key[1], parameters, rng)
            fix, taken = _follow(tracker, image, attitude)
            track[key].append(fix.position)
            seconds.append(taken)
    values: dict[str, Any] = {where: {} for where in pictures}
    series: dict[str, Any] = {"time_s": test.time - test.time[0], "truth_m": test.position}
    for (where, name), positions in track.items():
        drawing = stream(parameters.seed, f"intervals {where} {name}")
        error = euclidean(np.array(positions), test.position)
        settled = error[SETTLED:]
        values[where][name] = {
            "mean_cm": mean_with_interval(100 * settled[None], drawing),
            "p95_cm": 100 * np.percentile(settled, 95),
            "max_cm": 100 * settled.max(),
            "gross": int((settled > GROSS).sum()),
        }
        series[f"{where}_{name}_cm"] = 100 * error
    return values, series, _times(np.array(seconds))


# -- carried away ---------------------------------------------------------------------------------


def _carried(parameters: Parameters, index: int) -> dict[str, Any]:
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
        fix, _ = _follow(tracker, room.render(), _told(state.attitude, "attitude", parameters, rng))
        error.append(float(euclidean(fix.position, state.position[:2])))
        lost.append(fix.lost)
    right = np.array(error) < GROSS
    after = right[SETTLED:]
    runs = [at for at in range(len(after) - FOUND + 1) if after[at : at + FOUND].all()]
    return {
        "floor": number,
        "found": runs[0] if runs else None,
        "right": right,
        "lost": np.array(lost),
    }


def kidnapping_summary(trials: list[dict[str, Any]]) -> dict[str, Any]:
    """What many kidnappings say: how often found, and whether lost was said of the right frames.

    Kidnappings over one floor, and their frames, may be alike: rates are over floors.
    """
    floors = [trial["floor"] for trial in trials]
    calm = slice(5, SETTLED)

    def rate(happened: Sequence[Any], of: Sequence[Any]) -> dict[str, Any] | None:
        counts = ([np.sum(each) for each in column] for column in (happened, of))
        return success_rate(*(np.bincount(floors, each).astype(int) for each in counts))

    found = [trial["found"] for trial in trials if trial["found"] is not None]
    right, lost = ([trial[key] for trial in trials] for key in ("right", "lost"))
    both = list(zip(right, lost, strict=True))
    return {
        "found_rate": rate([trial["found"] is not None for trial in trials], [True] * len(trials)),
        "frames": {"median": float(np.median(found)), "longest": max(found)} if found else None,
        "wrong_not_lost": rate([~near & ~told for near, told in both], [~near for near in right]),
        "right_lost": rate(
            [(near & told)[calm] for near, told in both], [near[calm] for near in right]
        ),
    }


# -- light and peers ------------------------------------------------------------------------------


def _in_light(parameters: Parameters, drift: float) -> float:
    """Mean error in centimetres with attitude, the camera's gain drifting so much."""
    _, floor = painted_floor(0, 100)
    room = _room(floor, parameters, "light", 0, replace(CAMERA, exposure=drift))
    tracker = FloorTracker(floor.picture, room.camera, 1.0)
    rng, error = stream(parameters.seed, "light attitude"), []
    for state in _frames(room, parameters.frames, stream(parameters.seed, "light waypoints")):
        fix, _ = _follow(tracker, room.render(), _told(state.attitude, "attitude", parameters, rng))
        error.append(euclidean(fix.position, state.position[:2]))
    return 100 * float(np.mean(error[SETTLED:]))


def _peers(trials: list[dict[str, Any]]) -> dict[str, Any]:
    """For each keypoint method: frames tried, share within 30 cm, errors of those."""
    values = {}
    for name in trials[0]["peers"]:
        error = np.concatenate([trial["peers"][name][:, 0] for trial in trials])
        right = error[error < GROSS]  # NaN, where nothing was found, is not
        values[name] = {
            "frames": len(error),
            "right": len(right) / len(error),
            "mean_cm": 100 * right.mean() if len(right) else None,
        }
    return values


def _peer_times(trials: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        name: _times(np.concatenate([trial["peers"][name][:, 1] for trial in trials]))
        for name in trials[0]["peers"]
    }


def over_floors(
    record: Record, name: str, quantity: str, highest: float = np.inf
) -> dict[str, float | None]:
    """Mean of what stands in the record for each floor, with its 95 % interval over floors: frames
    over one floor share its print, and what was learned over it.
    """
    values = [floor[name][quantity] for floor in record.values["floors"].values()]
    return mean_over_groups(values, highest=highest)


def finding(record: Record, long: Record | None = None) -> str:
    """What the experiment found, in two sentences; over floors in the longer run, if there is
    one.
    """
    over = long or record
    everything = over.values["all"]
    words = {
        "attitude": "with the autopilot's attitude",
        "askew": f"with one that is {over.parameters['askew_deg']:g} degrees off",
        "free": "without",
    }
    parts = [
        f"{wording.interval(over_floors(over, key, 'mean_cm'), 'cm')} {words[key]}" for key in KNOWN
    ]
    frames = sum(everything[key]["frames"] for key in KNOWN)
    gross = sum(everything[key]["gross"] for key in KNOWN)
    stitched = [record.values["flight"]["stitched"][key]["mean_cm"] for key in ("attitude", "free")]
    known, alone = map(wording.distance, stitched)
    return (
        f"Over {len(over.values['floors'])} floors the image says where to "
        f"{', '.join(parts[:-1])} and {parts[-1]}; {gross} of {frames} frames are off by more than "
        f"{100 * GROSS:.0f} cm. On the stitched map of the recorded flight the mean error is "
        f"{known} with attitude and {alone} without."
    )
