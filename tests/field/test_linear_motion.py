"""Motion models with Gaussian noise, and that method field flies with any of them."""

from dataclasses import dataclass

import numpy as np
import pytest
from small_room import histogram_flight
from small_survey import AREA, errors_of, path, training

from trexton.base.errors import ParameterError
from trexton.field.linear_motion import LinearMotion, Singer, flight_statistics
from trexton.field.tracks import TrackFilter
from trexton.localization.localizer import Localizer
from trexton.localization.map_files import load_map, save_map
from trexton.localization.training import train_map


@dataclass(eq=False)
class CoordinatedTurn(LinearMotion):
    """A person's own, not linear: constant speed and turn rate (Bar-Shalom et al., Sec. 11.7)."""

    turning: float = 1.0  # rad/s, standard deviation of the turn rate

    def fit(self, training):
        speed, _, _ = flight_statistics(training.positions, training.time)
        return self.with_learned(speed=np.asarray(speed), period_s=np.asarray(training.period_s))

    def over(self, dt):
        transition = np.eye(5)
        transition[:2, 2:4] = dt * np.eye(2)
        return transition, dt * np.diag([1e-6, 1e-6, 0.5, 0.5, self.turning**2])

    @property
    def prior_variance(self):
        speed = float(self.speed) ** 2
        return np.array([0, 0, speed, speed, self.turning**2])

    def moved(self, states):
        dt = float(self.period_s)
        turned = dt * states[:, 4:] / 2  # the mean direction, and twice as far the new one
        x, y = states[:, 2:3], states[:, 3:4]

        def by(angle):
            return np.hstack(
                [np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y]
            )

        return np.hstack([states[:, :2] + dt * by(turned), by(2 * turned), states[:, 4:]])

    def jacobian(self, states):
        steps = 1e-6 * np.eye(5)
        columns = [(self.moved(states + s) - self.moved(states - s)) / 2e-6 for s in steps]
        return np.stack(columns, axis=-1)


@pytest.mark.parametrize("kind", [Singer, CoordinatedTurn])
def test_the_filter_of_method_field_takes_any_of_them(field, later, kind):
    tracker = TrackFilter(kind().fit(training()), field, AREA)
    errors = errors_of(tracker, *later)
    assert np.median(errors) < 0.1
    places, speed = later[0], tracker.estimate().velocity
    assert speed == pytest.approx((places[-1] - places[-2]) / 0.08, abs=0.3)


def test_ones_own_is_chosen_by_name_and_flown_from_the_stored_map(tmp_path):
    flight = histogram_flight("hall", frames=200)
    rng = np.random.default_rng(1)
    trained = train_map(flight, method="field", motion=f"{__name__}:CoordinatedTurn", rng=rng)
    texton_map = load_map(save_map(trained, tmp_path / "map.npz"))
    localizer = Localizer(texton_map, rng=np.random.default_rng(3))
    for histogram in flight.histograms[:20]:
        estimate = localizer.step(histogram)
    assert np.hypot(*(estimate.position - flight.position[19])) < 0.5
    assert estimate.joint.shape == (4, 4)


@pytest.mark.parametrize("name", ["speed", "period_s", "acceleration", "time_constant_s"])
@pytest.mark.parametrize("value", [0.0, -1.0, np.nan, np.inf, [0.1]])
def test_what_was_learned_is_a_positive_number(motion, name, value):
    arrays = motion.arrays() | {name: np.asarray(value)}
    with pytest.raises(ParameterError, match=f"{name} is .*expected a positive number"):
        Singer.from_arrays(arrays)


def test_a_step_is_two_halves(motion):
    whole, noise = motion.over(0.2)
    half, part = motion.over(0.1)
    np.testing.assert_allclose(whole, half @ half, atol=1e-12)
    np.testing.assert_allclose(noise, half @ part @ half.T + part, rtol=0.01, atol=1e-9)


def test_singer_learns_the_speed_of_the_flight(motion):
    places, time = path(500)
    speed = np.sqrt(np.square(np.gradient(places, time, axis=0)).mean())
    assert float(motion.speed) == pytest.approx(speed, rel=0.05)
    assert motion.growth(1.0)[0, 0] > motion.growth(0.1)[0, 0] > 0


def test_singer_moves_particles_as_it_says(motion, rng):
    states = np.zeros((20000, 6))
    states[:, 2] = 1.0
    moved = motion.sample(states, rng)
    np.testing.assert_allclose(motion.position(moved).mean(axis=0), [0.08, 0], atol=1e-3)
    np.testing.assert_allclose(np.cov(moved.T), motion.noise, atol=0.05 * motion.noise.max())
    near, far = motion.density(np.array([moved[0], states[0] + 5]), states[:1], np.ones(1))
    assert near > far
    started = motion.start(rng, AREA, 500)
    assert (started[:, :2] >= 0).all() and started[:, 0].max() <= 4


def test_singer_of_three_frames_is_finite():
    few = training(3)
    assert all(np.isfinite(value) for value in Singer().fit(few).arrays().values())


def test_agility_takes_accelerations_larger_than_flown(motion):
    once = Singer(agility=1.0).fit(training())
    assert float(motion.acceleration) == pytest.approx(2 * float(once.acceleration))
    with pytest.raises(ParameterError, match="agility"):
        Singer(agility=0.0)
    with pytest.raises(ParameterError, match="agility"):
        Singer(agility=np.inf)


def test_any_length_of_flight_has_statistics():
    """One of a certain length had a time constant that was no number."""
    for count in range(3, 14):
        time = np.arange(count) / 12
        found = flight_statistics(np.c_[np.cos(time), np.sin(time)], time)
        assert np.isfinite(found).all() and min(found) > 0, count
