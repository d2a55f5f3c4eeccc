"""The vehicle moves as a small quadrotor can, and lands where drift takes it."""

from __future__ import annotations

import numpy as np
import pytest

from trexton.base.errors import ParameterError
from trexton.simulator.recording import Plan, random_waypoints, survey
from trexton.simulator.simulator import PERIOD
from trexton.simulator.vehicle import STEP, Vehicle

AREA = (0.0, 5.0, 0.0, 5.0)


def flight(plan: Plan, frames: int, seed: int = 1, **options):
    vehicle = Vehicle(plan.start, rng=np.random.default_rng(seed), **options)
    return [vehicle.advance(PERIOD, plan.goal(vehicle.state.position)) for _ in range(frames)]


def test_speed_tilt_height_and_heading_stay_within_what_is_sensible():
    states = flight(Plan(random_waypoints(AREA, np.random.default_rng(1))), 2500, speed=0.5)
    velocity = np.array([state.velocity for state in states])
    speed = np.hypot(*velocity[:, :2].T)
    attitude = np.array([state.attitude for state in states])
    height = np.array([state.position[2] for state in states])
    assert 0.35 < np.median(speed) < 0.65 and speed.max() < 1.0
    assert np.degrees(np.abs(attitude[:, :2])).max() < 12
    assert abs(height.mean() - 1.0) < 0.02 and 0.02 < height.std() < 0.04
    assert abs(attitude[:, 2].std() - 0.03) < 0.012
    position = np.array([state.position[:2] for state in states])
    assert (position > -0.2).all() and (position < 5.2).all()


def test_velocity_and_rates_are_the_derivatives_of_what_is_flown():
    vehicle = Vehicle((1.0, 1.0), rng=np.random.default_rng(2))
    vehicle.advance(1.0, (4.0, 3.0))
    for _ in range(50):
        before, after = vehicle.state, vehicle.advance(STEP, (4.0, 3.0))
        position, attitude = before.pose(STEP)
        assert np.abs(after.position - position).max() < 5e-4
        assert np.abs(after.attitude - attitude).max() < 2e-3


def test_acceleration_leans_the_vehicle_towards_where_it_goes():
    vehicle = Vehicle((0.0, 0.0), yaw=0.0, rng=np.random.default_rng(3))
    state = vehicle.advance(0.35, (5.0, 5.0))
    roll, pitch, _ = state.attitude
    assert roll > 0.02 and pitch < -0.02  # right side down, nose down
    assert (state.velocity[:2] > 0.02).all()


def test_landing_takes_time_and_drifts():
    drift, seconds = [], []
    for seed in range(20):
        vehicle = Vehicle((0.0, 2.5), speed=0.6, rng=np.random.default_rng(seed))
        vehicle.advance(3.0, (5.0, 2.5))
        start = vehicle.state
        vehicle.land()
        while not vehicle.state.landed:
            vehicle.advance(PERIOD)
            assert vehicle.state.time - start.time < 10
        state = vehicle.state
        drift.append(state.position[0] - start.position[0])
        seconds.append(state.time - start.time)
        assert (state.velocity == 0).all()
        assert np.array_equal(vehicle.advance(1.0, (0.0, 0.0)).position, state.position)
    assert 2 < np.mean(seconds) < 4
    assert 0.1 < np.mean(drift) < 0.6 and np.std(drift) > 0.02


def test_it_lands_and_can_be_kidnapped():
    vehicle = Vehicle((1.0, 1.0), rng=np.random.default_rng(4))
    vehicle.land()
    vehicle.advance(8.0)
    assert vehicle.state.landed
    vehicle = Vehicle((1.0, 1.0), rng=np.random.default_rng(4))
    vehicle.teleport((4.0, 3.0))
    assert np.array_equal(vehicle.state.position[:2], (4.0, 3.0))
    assert np.hypot(*(vehicle.advance(PERIOD, (4.0, 3.0)).position[:2] - (4.0, 3.0))) < 0.1


@pytest.mark.parametrize(
    "options", [{"height": 0.0}, {"height": np.nan}, {"speed": 0.0}, {"speed": 99.0}]
)
def test_nonsense_is_refused(options):
    with pytest.raises(ParameterError):
        Vehicle((0.0, 0.0), rng=np.random.default_rng(0), **options)


def test_a_survey_of_the_usual_length_covers_the_area():
    states = flight(Plan(survey(AREA, 800 * PERIOD, 1.2)), 800, speed=1.2)
    flown = np.array([state.position[:2] for state in states])
    places = np.stack(np.meshgrid(*[np.linspace(0.3, 4.7, 23)] * 2), axis=-1).reshape(-1, 2)
    distance = np.hypot(*(places[:, None] - flown[None]).transpose(2, 0, 1)).min(axis=1)
    assert distance.max() < 0.75
    # The first hundred frames, from which the dictionary is learned, cross the area from corner to
    # corner.
    assert np.hypot(*np.ptp(flown[:100], axis=0)) > 5.5
    # Both axes are flown alike, so that the motion model sees both.
    assert (
        0.6
        < np.ptp(np.diff(flown, axis=0), axis=0)[0] / np.ptp(np.diff(flown, axis=0), axis=0)[1]
        < 1.7
    )


def test_a_survey_never_ends_and_random_waypoints_keep_apart():
    goals = survey((0.0, 5.0, 0.0, 3.0), 30, 0.6)
    lanes = np.array([next(goals) for _ in range(60)])
    assert (lanes >= 0.29).all() and (lanes <= (4.71, 2.71)).all()
    places = random_waypoints(AREA, np.random.default_rng(0))
    points = np.array([next(places) for _ in range(200)])
    assert np.hypot(*np.diff(points, axis=0).T).min() >= 1.0
    assert points.min() >= 0.3 and points.max() <= 4.7
