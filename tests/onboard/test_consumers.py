"""What an autopilot comes to believe if it fuses what it is told, by consumers of their own."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from onboard_consumers import Consumer, Delayed, ekf2, ekf3, readings
from onboard_tools import make_fix

pytest.importorskip("pymavlink", reason="the extra 'mavlink' is not installed")

from onboard_autopilot import AUTOPILOT_HEARTBEAT, attitude, from_autopilot  # noqa: E402

from trexton.onboard.fix import LocalFrame  # noqa: E402
from trexton.onboard.mavlink.listener import Listener  # noqa: E402
from trexton.onboard.mavlink.messages import PROFILES  # noqa: E402
from trexton.onboard.mavlink.speaker import Speaker  # noqa: E402

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


TICK = 0.01  # seconds: at its rate the estimator runs, and the conversation is polled
G = 9.81


class Flown:
    """A vehicle under way, its accelerometer, and what its autopilot makes of what it is sent.

    The level it believes in wanders by a seventh of a degree, which adds to what the accelerometer
    reads; images come `delay` seconds after their capture, as far as any come.
    """

    def __init__(self, seed: int = 3, seconds: float = 36.0, images: float = DT):
        rng = np.random.default_rng(seed)
        self.ticks = np.arange(round(seconds / TICK)) * TICK
        self.truth = place(self.ticks)
        tilt = np.zeros((len(self.ticks), 2))
        for step in range(1, len(tilt)):
            tilt[step] = 0.999 * tilt[step - 1] + rng.normal(0, 1e-4, 2)
        self.pushes = readings(self.truth, TICK, rng) + G * tilt
        self.captured = np.arange(0.5, seconds, images)
        self.seen = place(self.captured) + rng.normal(0, 0.15, (len(self.captured), 2))

    def fused(self, autopilot: Delayed, arrivals) -> tuple[float, float]:
        """Mean error in metres, and the share of ticks with the truth in the 90 % ellipse, at the
        horizon; `arrivals` gives the messages that have come at a tick."""
        errors, inside, shift = [], [], round(autopilot.horizon_s / TICK)
        for number, now in enumerate(self.ticks):
            for stamp, position, variances in arrivals(now):
                autopilot.receive(stamp, position, variances)
            autopilot.tick(now, self.pushes[number], TICK)
            if now > 10 and autopilot.consumer.state is not None:
                truth = self.truth[number - shift + 1]
                errors.append(np.hypot(*(autopilot.consumer.state[:2] - truth)))
                inside.append(autopilot.consumer.inside(truth))
        return float(np.mean(errors)), float(np.mean(inside))

    def once(self, delay: float):
        """Each image once, at its capture stamp: the best there is to be told."""
        waiting = list(zip(self.captured, self.seen, strict=True))

        def arrivals(now):
            while waiting and waiting[0][0] + delay <= now:
                captured, seen = waiting.pop(0)
                yield captured, seen, np.full(2, 0.0225)

        return arrivals

    def told(self, profile: str, delay: float, kept=lambda number: True):
        """What is sent of the same images."""
        talk = speaker(profile)
        waiting = [(t, p) for n, (t, p) in enumerate(zip(self.captured, self.seen, strict=True))
                   if kept(n)]  # fmt: skip

        def arrivals(now):
            if round(now / TICK) % 5 == 0:
                talk.listener.hear(from_autopilot(attitude(now)), now)
            while waiting and waiting[0][0] + delay <= now:
                captured, seen = waiting.pop(0)
                talk.tell(make_fix(captured, seen, 0.0225 * np.eye(2)), now)
            for message in talk.due(now):
                kind = message.get_type()
                if kind in ("VISION_POSITION_ESTIMATE", "ODOMETRY"):
                    stamp = getattr(message, "usec", None) or message.time_usec
                    matrix = getattr(message, "covariance", None) or message.pose_covariance
                    position = np.array([message.y, message.x])
                    yield 1e-6 * stamp, position, np.array([matrix[6], matrix[0]])

        return arrivals


@cache
def usual() -> Flown:
    return Flown()


def estimator(profile: str) -> Delayed:
    if profile == "px4":
        return Delayed(ekf2())
    return Delayed(ekf3(), 0.22, 0.02, start_s=0.5, stop_s=0.5)


@cache
def best(profile: str, delay: float) -> float:
    """The error of each image once."""
    flown = usual()
    return flown.fused(estimator(profile), flown.once(delay))[0]


def place(time: np.ndarray) -> np.ndarray:
    return 2 + 1.5 * np.column_stack([np.sin(0.9 * time), np.sin(0.61 * time)])


def speaker(profile: str):
    talk = Speaker(
        PROFILES[profile](LocalFrame(), (0.0, 4.0, 0.0, 4.0)), 0.01 * np.eye(2), Listener()
    )
    talk.listener.hear(from_autopilot(AUTOPILOT_HEARTBEAT), 0.0)
    return talk


@pytest.mark.parametrize("delay", [0.0, 0.06, 0.15])
@pytest.mark.parametrize("profile", ["px4", "ardupilot"])
def test_what_is_sent_is_fused_as_well_as_each_image_once(profile, delay):
    flown, autopilot = usual(), estimator(profile)
    error, inside = flown.fused(autopilot, flown.told(profile, delay))
    assert error < 1.1 * best(profile, delay) and 0.80 <= inside and not autopilot.dropped


@pytest.mark.parametrize("delay", [0.0, 0.15])
def test_missing_images_neither_end_the_fusion_nor_cost_the_next_one(delay):
    """Every tenth second three images in a row are not usable: a gap of 320 ms."""
    flown, autopilot = usual(), estimator("px4")
    error, inside = flown.fused(
        autopilot, flown.told("px4", delay, lambda number: number % 125 not in (50, 51, 52))
    )
    assert not autopilot.dropped and not autopilot.stops
    assert error < 1.1 * best("px4", delay) and 0.80 <= inside


def test_a_camera_of_four_images_a_second_is_fused_by_px4():
    flown, autopilot = Flown(images=0.25), estimator("px4")
    _, inside = flown.fused(autopilot, flown.told("px4", 0.0))
    assert autopilot.begun and not autopilot.stops and not autopilot.dropped
    assert 0.80 <= inside
