"""Visual odometry against the simulator's true motion."""

from __future__ import annotations

import numpy as np
import pytest

from trexton.base.errors import ParameterError
from trexton.simulator.sensor import Effects
from trexton.simulator.simulator import PERIOD, Simulator
from trexton.vision.camera import Camera
from trexton.vision.visual_odometry import VisualOdometry, shrink, shrunken_camera

CAMERA = Camera(320, 240, 260.0)
LEVEL = np.zeros(3)


def test_shrunken_pixels_see_where_the_blocks_they_average_lie():
    camera = Camera(64, 48, 52.0, (30.0, 25.0))
    small = shrunken_camera(camera, 4)
    pose = np.array([0.2, -0.1, 1.0]), np.array([0.05, -0.03, 0.4])
    block = np.array([4 * 5 + 1.5, 4 * 7 + 1.5, 1.0])  # the middle of block (5, 7)
    seen = camera.world_from_pixel(*pose) @ block
    small_seen = small.world_from_pixel(*pose) @ [5, 7, 1]
    assert np.allclose(seen[:2] / seen[2], small_seen[:2] / small_seen[2])
    image = np.arange(64 * 48, dtype=np.uint8).reshape(48, 64)
    assert shrink(image, 4).shape == (12, 16) and shrink(image, 1) is image


@pytest.mark.parametrize("tilted", [False, True], ids=["level", "tilted"])
def test_displacement_follows_the_vehicle(tilted):
    effects = Effects() if tilted else Effects().without("roll_pitch")
    room = Simulator(camera=CAMERA, effects=effects, rng=np.random.default_rng(3))
    odometry, errors, steps, truth = VisualOdometry(CAMERA, 160), [], [], room.state.position[:2]
    for _ in range(40):
        state = room.step(np.array([4.0, 3.0]))
        motion = odometry.step(
            room.render(), state.time, height=state.position[2], attitude=state.attitude
        )
        if motion is not None:
            displacement = PERIOD * motion[0]
            errors.append(np.hypot(*(displacement - (state.position[:2] - truth))))
            steps.append(np.hypot(*displacement))
        truth = state.position[:2]
    assert max(steps) > 0.03
    assert np.mean(errors) < 0.006


def test_unrelated_frames_are_not_sure():
    room = Simulator(camera=CAMERA, rng=np.random.default_rng(3))
    odometry = VisualOdometry(CAMERA, 160)
    odometry.step(room.render(), 0.0, height=1.0, attitude=LEVEL)
    near = odometry.step(room.render(), 0.1, height=1.0, attitude=LEVEL)
    room.vehicle.teleport((1.0, 1.0))
    room.step()
    far = odometry.step(room.render(), 0.2, height=1.0, attitude=LEVEL)
    assert near[1] > 0.5 > 0.2 > far[1]


def test_two_frames_moved_alike_whatever_came_before():
    """OpenCV writes the window into what it compares."""
    room = Simulator(camera=CAMERA, rng=np.random.default_rng(3))
    odometry, anew = VisualOdometry(CAMERA, 160), VisualOdometry(CAMERA, 160)
    frames = []
    for _ in range(3):
        room.step(np.array([4.0, 3.0]))
        frames.append(odometry.shrunken(room.render()))
    moved = [odometry.shift(frame) for frame in frames][-1]
    again = [anew.shift(frame) for frame in frames[1:]][-1]
    assert moved[1] > 0.3 and moved[1] == again[1] and np.array_equal(moved[0], again[0])


def test_after_a_reset_nothing_is_known():
    frame = np.zeros((240, 320), np.uint8)
    odometry = VisualOdometry(CAMERA, 160)
    assert odometry.step(frame, 0.0, height=1.0, attitude=LEVEL) is None
    odometry.reset()
    assert odometry.step(frame, 0.0, height=1.0, attitude=LEVEL) is None


@pytest.mark.parametrize("wrong", [{"width": 0}, {"focal": -260.0}, {"focal": np.nan},
                                   {"center": (np.nan, 3.0)}])  # fmt: skip
def test_a_camera_that_sees_nothing_is_refused(wrong):
    with pytest.raises(ParameterError, match="expected sizes and a focal length above 0"):
        Camera(**wrong)
