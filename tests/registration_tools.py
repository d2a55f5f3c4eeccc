"""Short virtual flights over one painted floor, and how far a tracker is off on them."""

from __future__ import annotations

from copy import deepcopy
from functools import cache

import cv2
import numpy as np

from trexton.registration.tracker import FloorTracker
from trexton.registration.trust import FloorFix
from trexton.simulator.floor import Floor
from trexton.simulator.recording import Plan, random_waypoints
from trexton.simulator.sensor import Effects
from trexton.simulator.simulator import Simulator
from trexton.vision.camera import Camera, MapImage

CAMERA = Camera(320, 240, 260.0)


def flight(frames: int = 40, layout: str = "hall"):
    """Frames, true positions and attitudes of a short flight, of at most 60 frames."""
    return _flown(layout)[:frames]


@cache
def _flown(layout: str):
    effects = Effects().without("jpeg")
    room = Simulator(
        Floor.painted(layout, 4), camera=CAMERA, effects=effects, rng=np.random.default_rng(5)
    )
    rows = []
    for _ in range(60):
        state = room.step(np.array([4.0, 3.4]))
        rows.append((room.render(), state.position, state.attitude))
    return rows


@cache
def waypoints(frames: int = 160, layout: str = "hall"):
    """As `flight`, there and back between places, so that it brakes and turns."""
    room = Simulator(
        Floor.painted(layout, 4), camera=CAMERA, effects=Effects().without("jpeg"),
        speed=0.6, rng=np.random.default_rng(6),
    )  # fmt: skip
    plan = Plan(random_waypoints(room.floor.area, np.random.default_rng(7)))
    rows = []
    for _ in range(frames):
        state = room.step(plan.goal(room.state.position))
        rows.append((room.render(), state.position, state.attitude))
    return rows


@cache
def _unused(layout: str) -> FloorTracker:
    return FloorTracker(Floor.painted(layout, 4).picture, CAMERA, 1.0)


def tracker_as_new(layout: str = "hall") -> FloorTracker:
    """Over the floor of `flight`, which is prepared once."""
    return deepcopy(_unused(layout))


def errors(tracker: FloorTracker, rows, known: bool) -> tuple[np.ndarray, list[FloorFix]]:
    rng = np.random.default_rng(1)
    fixes = []
    for frame, _, attitude in rows:
        measured = attitude + 0.005 * rng.standard_normal(3) if known else None
        fixes.append(tracker.step(frame, attitude=measured))
    truth = np.array([position[:2] for _, position, _ in rows])
    return np.hypot(*(np.array([fix.position for fix in fixes]) - truth).T), fixes


def covered(image: np.ndarray, top: int, left: int, rows: int, columns: int) -> np.ndarray:
    """The picture of a floor, with a rug of squares over a part of it."""
    drawn = np.random.default_rng(4).integers(0, 255, (16, 16, 3)).astype(np.uint8)
    image = image.copy()
    image[top : top + rows, left : left + columns] = cv2.resize(
        drawn, (columns, rows), interpolation=cv2.INTER_NEAREST
    )
    return image


def across(picture: MapImage, start, goal, frames: int):
    """As `flight`, over such a floor from one place to another."""
    room = Simulator(
        Floor(picture), camera=CAMERA, effects=Effects().without("jpeg"), start=start, speed=0.6,
        rng=np.random.default_rng(5),
    )  # fmt: skip
    rows = []
    for _ in range(frames):
        state = room.step(np.array(goal))
        rows.append((room.render(), state.position, state.attitude))
    return rows
