"""What an autopilot comes to believe if it fuses what it is told, by consumers of their own."""

from __future__ import annotations

import numpy as np
import pytest
from onboard_consumers import Consumer, ekf2, ekf3, readings
from onboard_tools import make_fix

DT = 0.08


def track(frames: int = 1500) -> np.ndarray:
    time = DT * np.arange(frames)
    return 2 + 1.5 * np.column_stack([np.sin(0.9 * time), np.sin(0.61 * time)])


def fused(consumer: Consumer, told, rng) -> tuple[float, float]:
    """Share of frames with the truth in the fused 90 % ellipse, and the mean NIS."""
    truth, inside = track(), []
    pushes = readings(truth, DT, rng)
    for number, position in enumerate(truth):
        for time, place, variances in told(number, position):
            consumer.tell(time, place, variances)
        if number > 100:
            inside.append(consumer.inside(position))
        consumer.drive(pushes[number], DT)
    return float(np.mean(inside)), float(np.mean(consumer.nis))


@pytest.mark.parametrize("make", [ekf2, ekf3])
def test_independent_errors_are_believed_as_they_deserve(make, rng):
    def told(number, position):
        yield DT * number, position + rng.normal(0, 0.3, 2), np.full(2, 0.09)

    inside, nis = fused(make(), told, rng)
    assert 0.80 <= inside <= 0.97 and 1.7 < nis < 2.3


@pytest.mark.parametrize("make", [ekf2, ekf3])
def test_errors_that_last_deceive_and_no_gate_notices(make, rng):
    """Why a filter's covariance must not be sent as if each image were independent."""
    error = np.zeros(2)

    def told(number, position):
        error[:] = 0.95 * error + np.sqrt(1 - 0.95**2) * rng.normal(0, 0.3, 2)
        yield DT * number, position + error, np.full(2, 0.09)

    inside, nis = fused(make(), told, rng)
    assert inside < 0.6 and nis < 1.5


def test_repetitions_for_px4_count_for_no_more_than_their_image(rng):
    pytest.importorskip("pymavlink")
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    from trexton.onboard.local import LocalFrame
    from trexton.onboard.mavlink.listener import Listener
    from trexton.onboard.mavlink.speaker import PROFILES, Speaker

    assert mavlink
    profile = PROFILES["px4"](LocalFrame(), (0.0, 4.0, 0.0, 4.0))
    talk = Speaker(profile, 1e-6 * np.eye(2), Listener())

    def told(number, position):
        # An image that stands still between frames: its repetitions carry the very same error.
        place, captured = position + rng.normal(0, 0.3, 2), 10 + DT * number
        talk.tell(make_fix(captured, place, 0.09 * np.eye(2)), captured)
        for tick in range(80):
            now = captured + tick / 1000
            for message in talk.due(now):
                if message.get_type() == "VISION_POSITION_ESTIMATE":
                    variances = np.array([message.covariance[6], message.covariance[0]])
                    yield now, np.array([message.y, message.x]), variances

    assert 0.80 <= fused(ekf2(), told, rng)[0]
