"""A virtual flight is recorded as a person's would be. Offers `record_flight`, which writes a
Flight folder, and where the vehicle flies: a survey in lanes, or random waypoints."""

import os
from collections.abc import Iterator
from functools import partial
from itertools import chain, cycle
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import ParameterError
from trexton.base.files import atomic_folder
from trexton.base.options import whole
from trexton.base.progress import progress
from trexton.flights.flight import Area, Flight
from trexton.flights.folder import read_flight
from trexton.flights.frames import ImageFiles
from trexton.flights.writing import write_tables
from trexton.simulator.floor import Floor, Light
from trexton.simulator.sensor import Effects
from trexton.simulator.simulator import PERIOD, Moment, Simulator
from trexton.vision.camera import Camera
from trexton.vision.images import decode_image
from trexton.vision.threads import ahead

# pattern: number of frames (the paper's), seed, speed in m/s, light, name of the split
PATTERNS = {
    "survey": (800, 1, 1.2, Light(), "train"),
    "waypoints": (415, 2, 0.6, Light.later(), "test"),
}
MARGIN = 0.3  # metres that plans keep from the area's edge
REACHED = 0.25  # metres from a waypoint at which the next one becomes the goal
AHEAD = 0.8  # metres that the goal runs ahead of the vehicle


class Plan:
    """A row of waypoints; the vehicle is led along the line to each until it is near."""

    def __init__(self, waypoints: Iterator[np.ndarray]):
        self._waypoints = waypoints
        self.start = self._last = next(waypoints)
        self._next = next(waypoints)

    def goal(self, position: np.ndarray) -> np.ndarray:
        """The ``(2,)`` goal for a vehicle at `position`: a point of the line, ahead of it."""
        leg = self._next - self._last
        # Two rows of lanes may share a corner.
        while np.hypot(*(self._next - position[:2])) < REACHED or not leg.any():
            self._last, self._next = self._next, next(self._waypoints)
            leg = self._next - self._last
        length = np.hypot(*leg)
        direction = leg / length
        along = np.clip((position[:2] - self._last) @ direction + AHEAD, 0, length)
        return self._last + along * direction


def _inside(area: Area) -> tuple[np.ndarray, np.ndarray]:
    x_min, x_max, y_min, y_max = area
    margin = min(MARGIN, (x_max - x_min) / 4, (y_max - y_min) / 4)
    return np.array([x_min, y_min]) + margin, np.array([x_max, y_max]) - margin


def survey(area: Area, seconds: float, speed: float) -> Iterator[np.ndarray]:
    """A diagonal, then lanes along x and along y that cover the area in about `seconds`, without
    end.

    The diagonal comes first because the dictionary is learned from the first frames (the first 100
    in the paper): they should see more than one edge of the room. Lanes both ways show the motion
    model both axes.

    Parameters
    ----------
    area : (x_min, x_max, y_min, y_max), metres
    """
    low, high = _inside(area)
    # At each corner the vehicle brakes, turns and gains speed again, which takes about a second and
    # a half.
    left = seconds - np.hypot(*(high - low)) / speed - 1.5
    lanes = int(np.clip(left / ((high - low).sum() / speed + 3), 2, 12))
    along_x, along_y = _lanes(high, low, lanes), _lanes(low[::-1], high[::-1], lanes, swap=True)
    return chain([low], cycle(chain(along_x, along_y)))


def _lanes(
    low: np.ndarray, high: np.ndarray, lanes: int, swap: bool = False
) -> Iterator[np.ndarray]:
    for number, across in enumerate(np.linspace(low[1], high[1], lanes)):
        for along in (low[0], high[0]) if number % 2 == 0 else (high[0], low[0]):
            yield np.array([across, along] if swap else [along, across])


def random_waypoints(area: Area, rng: np.random.Generator) -> Iterator[np.ndarray]:
    """Random places without end, a metre (or a third of the area) or more from the last."""
    low, high = _inside(area)
    apart = min(1.0, float((high - low).min()) / 3)
    last = rng.uniform(low, high)
    while True:
        yield last
        place = rng.uniform(low, high)
        while np.hypot(*(place - last)) < apart:
            place = rng.uniform(low, high)
        last = place


def record_flight(
    path: str | os.PathLike[str] | None,
    *,
    pattern: str = "survey",
    frames: int | None = None,
    seed: int | None = None,
    floor: Floor | None = None,
    camera: Camera = Camera(),
    effects: Effects = Effects(),
    light: Light | None = None,
    height: float = 1.0,
    speed: float | None = None,
    every: int = 1,
    replace: bool = False,
) -> Flight:
    """Fly in the virtual room and record it as a Flight folder; equal arguments give equal bytes.

    Parameters
    ----------
    path : path or None
        Folder to write, absent or empty unless `replace`; None: images stay in memory, no floor.
    pattern : {"survey", "waypoints"}
        A survey in lanes to train on, or random waypoints an hour later, under another light.
    frames, seed, light, speed : optional
        The pattern's own unless given: 800 or 415 frames. Another seed is another flight over the
        same floor.
    floor : Floor or None
        None is the painted hall.
    every : int
        Keep every n-th frame only, so that few frames cover the area.
    replace : bool
        Replace the folder whatever is in it.

    Raises
    ------
    ParameterError
        Unknown pattern, no frames, or a step below 1.
    """
    if pattern not in PATTERNS:
        raise ParameterError(f"unknown pattern {pattern!r}: the patterns are {', '.join(PATTERNS)}")
    usual_frames, usual_seed, usual_speed, usual_light, _ = PATTERNS[pattern]
    frames = whole(usual_frames if frames is None else frames, "the number of frames")
    every, seed = whole(every, "every"), whole(usual_seed if seed is None else seed, "the seed", 0)
    speed = usual_speed if speed is None else speed
    floor = Floor.painted() if floor is None else floor
    plan_rng, simulator_rng = np.random.default_rng(seed).spawn(2)
    if pattern == "survey":
        plan = Plan(survey(floor.area, frames * every * PERIOD, speed))
    else:
        plan = Plan(random_waypoints(floor.area, plan_rng))
    simulator = Simulator(
        floor, camera=camera, effects=effects, light=usual_light if light is None else light,
        start=plan.start, height=height, speed=speed, rng=simulator_rng,
    )  # fmt: skip
    flown = partial(_fly, simulator, plan, pattern, seed, frames, every)
    if path is None:
        return flown(None, pattern)
    with atomic_folder(path := Path(path), replace) as folder:
        write_tables(flown(folder, path.name), folder)
    return read_flight(path)


class _InMemory(ImageFiles):
    """Images whose `files` are the bytes of what would be written."""

    def __getitem__(self, row: int) -> np.ndarray:
        return decode_image(self.files[row])  # type: ignore[arg-type]


def _fly(
    simulator: Simulator, plan: Plan, pattern: str, seed: int, frames: int, every: int,
    folder: Path | None, name: str,
) -> Flight:  # fmt: skip
    """Fly the plan; images and floor are written to the folder, or images stay in memory."""
    files: list[Any] = []
    truth, floor = np.empty((frames, 6)), simulator.floor
    if folder is not None:
        (folder / "images").mkdir()
        (folder / "floor.png").write_bytes(floor.png())

    def moments() -> Iterator[Moment]:
        for index in progress(range(frames), "simulate", frames):
            for _ in range(every if index else 1):
                simulator.step(plan.goal(simulator.state.position))
            truth[index] = simulator.measure()
            yield simulator.moment()

    for index, (data, suffix) in enumerate(ahead(simulator.capture, moments())):
        files.append(data if folder is None else folder / "images" / f"{index:06d}{suffix}")
        if folder is not None:
            files[-1].write_bytes(data)
    return Flight(
        name=name, frame=np.arange(frames), time=np.arange(frames) * every * PERIOD,
        position=truth[:, :2], height=truth[:, 2], attitude=truth[:, 3:],
        frames=(_InMemory if folder is None else ImageFiles)(tuple(files)),
        area=floor.area, camera=simulator.camera, split={PATTERNS[pattern][-1]: (0, frames - 1)},
        floor_file=None if folder is None else folder / "floor.png",
        floor_from_pixel=floor.picture.world_from_pixel, licence="CC0-1.0",
        source=f"simulated by trexton: pattern {pattern}, seed {seed}",
    )  # fmt: skip
