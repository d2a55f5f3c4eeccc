"""Rooms that change: one path over a floor as it was surveyed, and as it looks later.

The light is another, half of the floor lies in shadow, the vehicle turns, flies higher, sends fewer
frames, or a rug was laid. Every method flies the same frames with a map of the same survey. What
counts is the error, and whether a method that is wrong calls itself lost. The paper names light,
heading and height as limits (Discussion).
"""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any
from zlib import crc32

import cv2
import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import SURVEYED, Experiment, option
from trexton.companion.experiments.floors import FloorParameters, mean_over_floors, scratch_folder
from trexton.companion.experiments.style import errors_by_row
from trexton.companion.experiments.track import fly
from trexton.companion.wording import distance, percent
from trexton.flights.aiding import Aiding
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer
from trexton.localization.training import for_method, train_map
from trexton.simulator.floor import Floor, Light
from trexton.simulator.recording import Plan, random_waypoints, record_flight
from trexton.simulator.sensor import Effects
from trexton.simulator.simulator import Simulator
from trexton.simulator.vehicle import VehicleState
from trexton.vision.camera import Camera, MapImage

FIRST_FLOOR = 1300  # seed of the first painted floor; no setting was chosen on these
METHODS = ("paper", "field", "fine")
WRONG_M = 0.3
SHADE, RUG_SHARE, RUG_TILE = 0.65, 0.1, 0.05  # gain, share of the floor, metres
SPEED = 0.6  # metres a second
SETTLED_S = 2.0  # since a rug left the view
# Of each frame of one flight by one method: its error in metres, whether it was called lost, and
# whether the region that should hold 90 % held the truth.
_Flown = tuple[np.ndarray, np.ndarray, np.ndarray]


class _Turning(Simulator):
    """A vehicle that flies at another heading than the survey."""

    heading = 0.0

    @property
    def state(self) -> VehicleState:
        state = super().state
        return replace(state, attitude=state.attitude + np.array([0.0, 0.0, self.heading]))


@dataclass(frozen=True)
class Change:
    """What is other than at the survey."""

    words: str
    light: Light = field(default_factory=Light)
    shadow: bool = False
    rug: bool = False
    turn_deg: float = 0.0  # over the whole flight
    yaw: bool = False  # whether the heading comes with the frames
    height: float = 1.0  # over that of the survey
    rate: float = 1.0  # of frames, over that of the survey


CHANGES = {
    "none": Change("as surveyed"),
    "dim": Change("10 % dimmer", Light(gain=0.9)),
    "warm": Change("20 % dimmer and warmer", Light(gain=0.8, warmth=0.05)),
    "cold": Change("20 % brighter and colder", Light(gain=1.2, warmth=-0.05)),
    "shadow": Change("half of the floor in shadow", shadow=True),
    "turn": Change("turned slowly by 90 degrees", turn_deg=90),
    "yaw": Change("the same, its yaw given", turn_deg=90, yaw=True),
    "high": Change("20 % higher", height=1.2),
    "slow": Change("5 frames a second", rate=0.4),
    "rug": Change("a rug over a tenth of the floor", rug=True),
}
_WORDS = {name: change.words for name, change in CHANGES.items()}
_WORDS["left"] = "of these, from 2 s after the rug left the view"


@dataclass(frozen=True)
class Parameters(FloorParameters):
    """What can be chosen."""

    survey: int = option(400, "frames of the survey", low=100)
    frames: int = option(40, "of every flight", low=10)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Fly one path over each floor, of `FloorParameters.over_each`, under one change after another.

    Of `test` nothing is used.
    """
    floors = parameters.over_each(train, partial(_over, parameters), FIRST_FLOOR)
    rng = stream(parameters.seed, "intervals")

    def summary(change: str, method: str) -> dict[str, Any]:
        flown = (over[change][method] for over in floors)
        by_floor, *shares = zip(*flown, strict=True)
        errors, lost, held = (np.concatenate(each) for each in (by_floor, *shares))
        return {
            "error_cm": mean_over_floors([100 * each for each in by_floor], rng),
            "wrong": float(((errors > WRONG_M) & ~lost).mean()),
            "lost": float(lost.mean()),
            "held": float(held.mean()),
        }

    changes = {
        change: {method: summary(change, method) for method in floors[0][change]}
        for change in _WORDS
        if all(change in over for over in floors)
    }
    values = {"changes": changes, "floors": len(floors), "frames": parameters.frames}
    return parameters.record(train, values=values)


def _over(
    parameters: Parameters, seed: int, floor: Floor, camera: Camera, height: float
) -> dict[str, dict[str, _Flown]]:
    """By change and method, what was flown over one floor."""
    with scratch_folder("rooms") as folder:
        room: dict[str, Any] = {"floor": floor, "camera": camera, "height": height}
        survey = record_flight(folder / "survey", frames=parameters.survey, seed=seed, **room)
        base = train_map(survey, rng=stream(seed, "map"))
        maps = {
            method: for_method(base, method, flight=survey, rng=stream(seed, f"map {method}"))
            for method in METHODS
        }
    found: dict[str, dict[str, _Flown]] = {}
    surveyed: list[int] = []
    for name, change in CHANGES.items():
        frames, times, truth, aiding = _flight(
            parameters.frames, seed, floor, camera, height, change
        )
        pictures = [crc32(frame.tobytes()) for frame in frames]
        surveyed = surveyed or pictures
        found[name] = {}
        for method, texton_map in maps.items():
            localizer = Localizer(texton_map, rng=stream(seed, "flight"))
            track = fly(localizer, frames, aiding=aiding, times=times)
            found[name][method] = (track.errors(truth), track.lost, track.held(truth))
        if change.rug:  # in view where a frame is other than over the floor as surveyed
            left = _left(np.not_equal(surveyed, pictures), times)
            if left.any():
                found["left"] = {
                    method: (errors[left], lost[left], held[left])
                    for method, (errors, lost, held) in found[name].items()
                }
    return found


def _left(shown: np.ndarray, times: np.ndarray) -> np.ndarray:
    """``(N,)`` whether a rug, `shown` in ``(N,)`` frames, left the view `SETTLED_S` ago or more."""
    since = times - np.maximum.accumulate(np.where(shown, times, -np.inf))
    return np.isfinite(since) & (since >= SETTLED_S)


def _flight(
    count: int, seed: int, floor: Floor, camera: Camera, height: float, change: Change
) -> tuple[list[np.ndarray], np.ndarray, np.ndarray, list[Aiding]]:
    """Frames, their ``(N,)`` seconds, ``(N, 2)`` positions and aiding of the path that all changes
    of a floor share.
    """
    plan_rng, simulator_rng = stream(seed, "later").spawn(2)
    plan = Plan(random_waypoints(floor.area, plan_rng))
    room: dict[str, Any] = {"camera": camera, "height": height * change.height}
    room |= {"light": change.light, "effects": Effects().without("jpeg")}
    flown: dict[str, Any] = {"start": plan.start, "speed": SPEED, "rng": simulator_rng}
    simulator = _Turning(changed_floor(floor, change), **room, **flown)
    kept = np.unique((np.arange(count) / change.rate).astype(int))
    frames, times, places, aiding = [], [], [], []
    for number in range(kept[-1] + 1):
        simulator.heading = np.radians(change.turn_deg) * number / kept[-1]
        simulator.step(plan.goal(simulator.vehicle.state.position))
        if number in kept:
            frames.append(simulator.render())
            times.append(simulator.state.time)
            places.append(simulator.state.position[:2])
            yaw = float(simulator.state.attitude[2]) if change.yaw else None
            aiding.append(Aiding(yaw=yaw))
    return frames, np.array(times), np.array(places), aiding


def changed_floor(floor: Floor, change: Change) -> Floor:
    """The floor with a shadow over its left half, or with a rug of squares."""
    picture, image = floor.picture, floor.picture.image.copy()
    rows, columns = image.shape[:2]
    if change.shadow:
        image[:, : columns // 2] = (SHADE * image[:, : columns // 2]).astype(np.uint8)
    if change.rug:
        side = int(np.sqrt(RUG_SHARE * rows * columns))
        metres = float(np.ptp(picture.corners[:, 0])) * side / columns
        squares = max(2, round(metres / RUG_TILE))
        drawn = np.random.default_rng(4).integers(0, 255, (squares, squares, 3)).astype(np.uint8)
        top, left = rows // 3, 2 * columns // 5
        rug = cv2.resize(drawn, (side, side), interpolation=cv2.INTER_NEAREST)
        image[top : top + side, left : left + side] = rug[: rows - top, : columns - left]
    return Floor(MapImage(image, picture.world_from_pixel, picture.mask))


def finding(record: Record) -> str:
    """What the experiment found, in sentences."""
    flown = {name: record.values["changes"][name]["field"] for name in CHANGES}
    errors = {name: each["error_cm"]["value"] for name, each in flown.items()}
    grown = max(errors, key=lambda name: errors[name])
    wrong = max(flown, key=lambda name: flown[name]["wrong"])
    lost = sorted(each["lost"] for each in flown.values())
    return (
        f"As surveyed the mean error of method field is {distance(flown['none']['error_cm'])}. "
        f"It is largest with this change: {CHANGES[grown].words}, "
        f"{errors[grown] / errors['none']:.1f} times as large. "
        f"At most {percent(flown[wrong]['wrong'])} of the frames are wrong by more than 30 cm and "
        f"not called lost ({CHANGES[wrong].words}). The price is that {percent(lost[0])} to "
        f"{percent(lost[-1])} are called lost."
    )


def errors(record: Record) -> Figure:
    """Mean error of each method with its interval, a row for each change."""
    changes = record.values["changes"]
    flown = {m: {name: changes[name][m]["error_cm"] for name in CHANGES} for m in METHODS}
    return errors_by_row({name: _WORDS[name] for name in CHANGES}, flown)


def table(record: Record, method: str) -> pd.DataFrame:
    """Of one method: its mean error, frames that are wrong and not called lost, lost ones, and what
    regions hold, a row for each change.
    """
    rows = [(_WORDS[name], each[method]) for name, each in record.values["changes"].items()]
    return pd.DataFrame(
        [
            {
                "change": words,
                "mean error": distance(flown["error_cm"]),
                "wrong, not lost": percent(flown["wrong"]),
                "lost": percent(flown["lost"]),
                "90 % region covers": percent(flown["held"]),
            }
            for words, flown in rows
        ]
    )


EXPERIMENT = Experiment("Rooms that change", Parameters, run, finding, needs=SURVEYED, cost_s=120)
