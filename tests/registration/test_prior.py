"""Coarse to fine with an attitude and a height that are right, wrong in many ways, or missing."""

from __future__ import annotations

import numpy as np
import pytest
from registration_tools import errors, flight, tracker_as_new, waypoints

from trexton.registration.alignment import Alignment
from trexton.registration.prior import PosePrior


def test_without_a_heading_roll_and_pitch_still_count():
    tracker = tracker_as_new()
    for frame, position, attitude in flight(20):
        measured = np.array([*attitude[:2], np.nan])
        fix = tracker.step(frame, attitude=measured, height=position[2])
    assert np.hypot(*(fix.position - flight(20)[-1][1][:2])) < 0.02


@pytest.mark.parametrize("off", [(0.0, 0.0), (0.05, 0.0), (0.0, -0.17), (0.26, 0.1)])
def test_the_bias_of_a_measured_tilt_is_learned(off):
    tracker = tracker_as_new()
    biased = [(frame, place, attitude + [*off, 0]) for frame, place, attitude in flight(60)]
    error, _ = errors(tracker, biased, True)
    assert error[25:].mean() < 0.012
    assert np.abs(tracker.pose_prior.tilt.mean + off).max() < 0.009
    said = tracker.pose_prior.tilt.tilt_bias
    assert said is None if max(np.abs(off)) < 0.03 else np.abs(said - off).max() < 0.009
    assert (tracker.tilt_bias is None) == (said is None)
    tracker.step(flight(60)[-1][0])
    assert tracker.tilt_bias is None  # no tilt is measured any more


@pytest.mark.parametrize("axes", [[[-1, 0], [0, -1]], [[0, 1], [1, 0]]], ids=["signs", "order"])
def test_roll_and_pitch_of_another_convention_mislead_little(axes):
    tracker = tracker_as_new()
    rows = waypoints()
    turned = [(frame, place, [*(axes @ angles[:2]), angles[2]]) for frame, place, angles in rows]
    error, _ = errors(tracker, turned, True)
    assert error[50:].mean() < 0.009
    assert tracker.tilt_bias is not None  # worth a warning


def test_an_unmeasured_tilt_is_expected_as_it_was():
    last = np.array([1.0, 2.0, 1.1, 0.06, -0.04, 0.3])
    prior = PosePrior(1.0, 0.007, 0.02).prior(None, None, last, 1)
    assert prior.mean[3:5] == pytest.approx(0.85 * last[3:5], rel=0.02)
    assert 0.02 < prior.deviation[3] == prior.deviation[4] < 0.03
    tracker = tracker_as_new()
    error, _ = errors(tracker, waypoints(), False)
    assert error[25:].mean() < 0.008


def test_a_tilt_that_changes_much_is_expected_less_like_before():
    expected, rng = PosePrior(1.0, 0.007, 0.02), np.random.default_rng(1)
    pose = np.array([1.0, 2.0, 1.0, 0.0, 0.0, 0.0])
    for _ in range(60):
        prior = expected.prior(None, None, pose, 1)
        pose = np.array([*pose[:3], *(0.06 * rng.standard_normal(2)), 0.0])
        expected.learn(prior, Alignment(pose, 1e-5 * np.eye(6), 0.9, 0.1))
    prior = expected.prior(None, None, pose, 1)
    assert 0.04 < prior.deviation[3] < 0.07
    assert np.all(np.abs(prior.mean[3:5]) < 0.6 * np.abs(pose[3:5]))


@pytest.mark.parametrize("off", [0.35, 1.6])
def test_a_wrong_heading_is_left_aside_once_nothing_is_found_with_it(off):
    tracker = tracker_as_new()
    error, lost = [], []
    for frame, position, attitude in flight(60):
        fix = tracker.step(frame, attitude=attitude + [0, 0, off])
        error.append(np.hypot(*(fix.position - position[:2])))
        lost.append(fix.lost)
    assert not tracker.pose_prior.uses_heading
    assert max(error[-12:]) < 0.03 and not any(lost[-12:])
    assert np.mean(np.array(lost)[np.array(error) > 0.3]) > 0.6


@pytest.mark.parametrize("heading", [0.0, np.nan])
def test_a_height_of_half_is_left_aside_once_nothing_is_found_with_it(heading):
    tracker = tracker_as_new()
    for frame, position, attitude in flight(60):
        fix = tracker.step(frame, attitude=attitude + [0, 0, heading], height=0.5 * position[2])
    assert not tracker.pose_prior.uses_heading and not fix.lost
    assert np.hypot(*(fix.position - position[:2])) < 0.03
    assert abs(fix.pose[2] - position[2]) < 0.05


def test_a_heading_that_is_right_again_is_gone_by_again():
    tracker = tracker_as_new()
    for row, (frame, _, attitude) in enumerate(flight(60)):
        tracker.step(frame, attitude=attitude + [0, 0, 1.6 * (row < 50)])
    assert tracker.pose_prior.uses_heading
