"""A virtual flight is recorded as a person's would be. Offers `record_flight`, which writes a
Flight folder."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from trexton.base.errors import ParameterError
from trexton.base.files import atomic_folder
from trexton.base.options import whole
from trexton.base.progress import progress
from trexton.flights import Flight, read_flight
from trexton.flights.frames import ImageFiles
from trexton.flights.writing import write_tables
from trexton.simulator.effects import Effects, Light
from trexton.simulator.floor import Floor
from trexton.simulator.plans import Plan, random_waypoints, survey
from trexton.simulator.simulator import PERIOD, Simulator
from trexton.vision.camera import Camera

__all__ = ["PATTERNS", "record_flight"]

# pattern: number of frames (the paper's), seed, speed in m/s, light, name of the split
PATTERNS = {
    "survey": (800, 1, 1.2, Light(), "train"),
    "waypoints": (415, 2, 0.6, Light.later(), "test"),
}


def record_flight(
    path: str | os.PathLike[str],
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
    path : path
        Folder to write; a recorded flight that is there, and unchanged, is replaced.
    pattern : {"survey", "waypoints"}
        A survey in lanes for training, or random waypoints an hour later, under another light, for
        test.
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
    usual_frames, usual_seed, usual_speed, usual_light, split = PATTERNS[pattern]
    frames = usual_frames if frames is None else frames
    seed = usual_seed if seed is None else seed
    speed = usual_speed if speed is None else speed
    frames, every = whole(frames, "the number of frames"), whole(every, "every")
    seed = whole(seed, "the seed", 0)
    floor = Floor.hall() if floor is None else floor
    plan_rng, simulator_rng = np.random.default_rng(seed).spawn(2)
    if pattern == "survey":
        plan = Plan(survey(floor.area, frames * every * PERIOD, speed))
    else:
        plan = Plan(random_waypoints(floor.area, plan_rng))
    simulator = Simulator(
        floor, camera=camera, effects=effects, light=usual_light if light is None else light,
        start=plan.start, height=height, speed=speed, rng=simulator_rng,
    )  # fmt: skip
    path = Path(path)
    with atomic_folder(path, replace) as folder:
        (folder / "floor.png").write_bytes(floor.png())
        files, truth = _fly(simulator, plan, folder, frames, every)
        flight = Flight(
            name=path.name,
            frame=np.arange(frames),
            time=np.arange(frames) * every * PERIOD,
            position=truth[:, :2],
            height=truth[:, 2],
            attitude=truth[:, 3:],
            frames=ImageFiles(files),
            area=floor.area,
            camera=camera,
            split={split: (0, frames - 1)},
            floor_file=folder / "floor.png",
            floor_from_pixel=floor.picture.world_from_pixel,
            source=f"simulated by trexton: pattern {pattern}, seed {seed}",
            licence="CC0-1.0",
        )
        write_tables(flight, folder)
    return read_flight(path)


def _fly(
    simulator: Simulator, plan: Plan, folder: Path, frames: int, every: int
) -> tuple[tuple[Path, ...], np.ndarray]:
    """Write the images; return their files and ``(frames, 6)`` truth."""
    (folder / "images").mkdir()
    files, truth = [], np.empty((frames, 6))
    for index in progress(range(frames), "simulate", frames):
        for _ in range(every if index else 1):
            simulator.step(plan.goal(simulator.state.position))
        truth[index] = simulator.measure()
        data, suffix = simulator.capture()
        files.append(folder / "images" / f"{index:06d}{suffix}")
        files[-1].write_bytes(data)
    return tuple(files), truth
