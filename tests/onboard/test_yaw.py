"""The heading that method `fine` finds by itself: how far it is off, and a vehicle without a
compass that flies by it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trexton.flights.aiding import Aiding
from trexton.localization.localizer import Localizer
from trexton.localization.training import train_map
from trexton.onboard.fix import Continuity, Fix, LocalFrame
from trexton.simulator.floor import Floor
from trexton.simulator.recording import record_flight
from trexton.simulator.simulator import Simulator
from trexton.vision.camera import Camera

PERIOD = 0.08
CAMERA = Camera(160, 120, 130.0)


def floor() -> Floor:
    return Floor.painted("moved", 4)  # which keeps it


class Turned(Simulator):
    """A vehicle that flies with another heading than it was surveyed with."""

    offset = 0.0  # radians

    @property
    def state(self):
        state = super().state
        return replace(state, attitude=state.attitude + [0, 0, self.offset])


def turned(seed: int, offset: float) -> Turned:
    made = Turned(
        floor(), camera=CAMERA, start=np.array([1.0, 1.0]), speed=0.6,
        rng=np.random.default_rng(seed),
    )  # fmt: skip
    made.offset = offset
    return made


@pytest.fixture(scope="module")
def fine(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fine")
    flight = record_flight(folder / "survey", frames=100, camera=CAMERA, floor=floor())
    return train_map(flight, method="fine", n_textons=8, rng=np.random.default_rng(1))


def off(found: float, true: float) -> float:
    return float(np.angle(np.exp(1j * (found - true))))


def test_the_heading_is_within_two_degrees_also_after_it_was_carried_away(fine):
    room, localizer, rng = turned(5, 2.5), Localizer(fine, rng=rng_of(1)), rng_of(3)
    errors, sigmas, unknown = [], [], 0
    for frame in range(160):
        if frame % 40 == 39:
            room.vehicle.teleport(rng.uniform(1.0, 4.0, 2))
            room.offset = rng.uniform(-np.pi, np.pi)
        room.step(np.array([2.0, 2.0]) + np.array([np.sin(frame / 15), np.cos(frame / 15)]))
        room.offset += 0.4 * PERIOD
        estimate = localizer.step(room.render())
        if estimate.heading is None:
            assert estimate.heading_sigma is None
            unknown += 1
        else:
            assert not estimate.lost
            errors.append(off(estimate.heading, room.state.attitude[2]))
            sigmas.append(estimate.heading_sigma)
    assert np.mean(np.abs(errors) < np.radians(2)) >= 0.95 and unknown < 80
    assert 0.8 < np.mean(np.abs(errors) < 1.645 * np.array(sigmas))


def test_a_compass_does_not_get_its_own_yaw_nor_a_prediction_a_heading(fine):
    room, localizer = turned(5, 0.0), Localizer(fine, rng=rng_of(1))
    for _ in range(25):
        room.step(np.array([2.0, 2.0]))
        estimate = localizer.step(room.render())
    assert abs(estimate.heading - room.state.attitude[2]) < np.radians(2)
    assert localizer.step(None).heading is None
    yaw = Aiding(yaw=float(room.state.attitude[2]))
    aided = localizer.step(room.render(), aiding=yaw)
    assert aided.heading is None and not aided.lost


class WithoutCompass:
    """A vehicle that integrates a gyroscope with a bias, and knows its yaw by what it is sent.

    It takes the way to its goal into its own axes by the yaw that it believes, and flies it by the
    true one.
    """

    def __init__(self, room: Turned, local: LocalFrame):
        self.room, self.local = room, local
        self.position, self.yaw, self.before = None, 0.0, room.offset

    def hear(self, message) -> None:
        self.position = np.array([message.x, message.y])
        if np.isfinite(message.yaw):
            self.yaw += 0.3 * off(message.yaw, self.yaw)

    def fly(self, goal: np.ndarray) -> None:
        room = self.room
        self.yaw -= room.offset - self.before - 0.02 * PERIOD  # clockwise, with a bias
        self.before = room.offset
        target = None
        if self.position is not None:
            way = self.local.ned(goal)[:2] - self.position
            astray = self.local.yaw(room.state.attitude[2]) - self.yaw
            turn = np.array([[np.cos(astray), -np.sin(astray)], [np.sin(astray), np.cos(astray)]])
            target = room.state.position[:2] + self.local.ned_from_map @ (turn @ way)
        room.step(target)


@pytest.mark.parametrize("send_yaw", [True, False])
def test_a_vehicle_without_a_compass_flies_by_it(fine, send_yaw):
    pytest.importorskip("pymavlink", reason="the extra 'mavlink' is not installed")
    from onboard_autopilot import AUTOPILOT_HEARTBEAT, attitude, from_autopilot

    from trexton.onboard.mavlink.listener import Listener
    from trexton.onboard.mavlink.messages import PROFILES
    from trexton.onboard.mavlink.speaker import Speaker

    local, goal = LocalFrame(0.5), np.array([2.8, 2.6])
    room, localizer = turned(7, 2.2), Localizer(fine, rng=rng_of(1))
    vehicle, continuity = (
        WithoutCompass(room, local),
        Continuity(localizer.parts["motion"].growth, PERIOD),
    )
    talk = Speaker(
        PROFILES["px4"](local, floor().area), 0.01 * np.eye(2), Listener(), send_yaw=send_yaw
    )
    talk.listener.hear(from_autopilot(AUTOPILOT_HEARTBEAT), 0.0)
    distances = []
    for frame in range(90):
        now = 1.0 + PERIOD * frame
        talk.listener.hear(from_autopilot(attitude(now, (0.0, 0.0, vehicle.yaw))), now)
        estimate = localizer.step(room.render())
        fix = continuity.mark(Fix.of(estimate, now, frame, floor().area, PERIOD))
        talk.tell(fix, now)
        for message in talk.due(now):
            if message.get_type() == "VISION_POSITION_ESTIMATE":
                vehicle.hear(from_autopilot(message))
        vehicle.fly(goal)
        room.offset += 0.2 * PERIOD
        distances.append(np.hypot(*(room.state.position[:2] - goal)))
    arrived = max(distances[-20:]) < 0.5
    assert arrived == send_yaw, distances[::10]


def rng_of(seed: int) -> np.random.Generator:
    return np.random.default_rng(seed)
