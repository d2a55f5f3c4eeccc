"""Receivers of positions, against those of `onboard_consumers`."""

import numpy as np
import pytest
from onboard_consumers import ekf2, ekf3

from trexton.companion.experiments.receivers import RECEIVERS, Receiver, readings

DT = 0.08


def track(frames: int) -> tuple[np.ndarray, np.ndarray]:
    time = DT * np.arange(frames)
    return time, 2 + 1.5 * np.column_stack([np.sin(0.9 * time), np.sin(0.61 * time)])


@pytest.mark.parametrize(("name", "make"), [("ekf2", ekf2), ("ekf3", ekf3)])
def test_a_receiver_believes_what_an_independent_one_does(rng, name, make):
    """Step by step, outliers that both gates refuse among them."""
    time, truth = track(300)
    pushes = readings(truth, time, 1, rng)
    ours, theirs = Receiver(RECEIVERS[name], 1), make()
    for row, place in enumerate(truth):
        if row:
            ours.drive(pushes[row - 1], DT)
            theirs.drive(pushes[row - 1, 0], DT)
        told = place + rng.normal(0, 0.3, 2) + (50.0 if row % 40 == 39 else 0.0)
        variances = np.array([0.09, 0.16])
        ours.fuse(time[row], told, variances)
        theirs.tell(time[row], told, variances)
        np.testing.assert_allclose(ours.position[0], theirs.state[:2], atol=1e-9)
        np.testing.assert_allclose(ours.velocity[0], theirs.state[2:], atol=1e-9)
        np.testing.assert_allclose(ours.variance[0], np.diagonal(theirs.covariance)[:2])
    assert np.hypot(*(ours.position[0] - truth[-1])) < 1


def test_the_accelerometer_follows_the_track(rng):
    time, truth = track(50)
    pushes = readings(truth, time, 20000, rng).mean(axis=1, keepdims=True)  # noise averages out
    receiver = Receiver(RECEIVERS["ekf2"], 1)
    receiver.fuse(0.0, truth[0], np.full(2, 1e-6))
    receiver.velocity = (truth[1] - truth[0])[None] / DT
    for push in pushes:
        receiver.drive(push, DT)
    np.testing.assert_allclose(receiver.position[0], truth[-1], atol=0.1)


def test_refusals_end_with_a_reset_to_what_is_told():
    receiver = Receiver(RECEIVERS["ekf3"], 2)
    for row in range(200):
        place = np.zeros(2) if row < 50 else np.array([100.0, 0.0])
        receiver.fuse(DT * row, place, np.full(2, 0.04))
        if row == 60:
            assert np.abs(receiver.position).max() < 1  # refused: it cannot have moved so far
        receiver.drive(np.zeros((2, 2)), DT)
    np.testing.assert_allclose(receiver.position, [[100, 0], [100, 0]], atol=0.5)
