"""Fixes: no less uncertainty than the filter has, whatever the point estimate, the axes or the
receiver.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from onboard_tools import make_estimate, make_fix

from trexton.localization.estimate import LOST_SHARE, Measurement, ignorance
from trexton.localization.localizer import Estimate
from trexton.onboard.fix import Continuity, Fix, LocalFrame, decoupled


def random_estimate(rng: np.random.Generator) -> Estimate:
    particles = rng.normal(size=(30, 2)) @ rng.normal(size=(2, 2)) + rng.choice([0, 3], (30, 1))
    weights = rng.dirichlet(np.ones(30))
    covariance = np.cov(particles.T, aweights=weights, bias=True)
    return Estimate(
        particles[0],
        covariance,
        mean=weights @ particles,
        particles=particles,
        weights=weights,
    )


def test_covariance_is_the_second_moment_about_the_reported_position(rng):
    for _ in range(20):
        estimate = random_estimate(rng)
        expected = sum(
            weight * np.outer(particle - estimate.position, particle - estimate.position)
            for particle, weight in zip(estimate.particles, estimate.weights, strict=False)
        )
        np.testing.assert_allclose(estimate.about_position, expected)
        assert np.linalg.eigvalsh(estimate.about_position - estimate.covariance).min() > -1e-12


def test_decoupled_diagonal_covers_the_cloud_in_every_direction(rng):
    for _ in range(50):
        half = rng.normal(size=(2, 2))
        covariance = half @ half.T
        bound = decoupled(covariance)
        assert np.linalg.eigvalsh(bound - covariance).min() > -1e-12
        assert np.linalg.eigvalsh(np.diag(bound.diagonal()) - covariance).min() > -1e-12


@pytest.mark.parametrize(
    ("heading", "along_x", "along_y"),
    [(0, (0, 1), (1, 0)), (90, (-1, 0), (0, 1)), (180, (0, -1), (-1, 0)), (270, (1, 0), (0, -1))],
)
def test_heading_turns_the_map_clockwise_from_north(heading, along_x, along_y):
    local = LocalFrame(np.radians(heading), 1.5)
    np.testing.assert_allclose(local.ned(np.array([1.0, 0.0])), [*along_x, -1.5], atol=1e-12)
    np.testing.assert_allclose(local.ned(np.array([0.0, 1.0])), [*along_y, -1.5], atol=1e-12)
    np.testing.assert_allclose(
        local.enu(np.array([0.0, 1.0])), [along_y[1], along_y[0], 1.5], atol=1e-12
    )


def test_rotated_covariance_is_that_of_rotated_points(rng):
    local = LocalFrame(0.7, 1.0)
    points = rng.normal(size=(500, 2)) @ [[1.0, 0.3], [0.0, 0.2]]
    rotated = np.array([local.ned(point)[:2] for point in points])
    np.testing.assert_allclose(
        local.ned_covariance(np.cov(points.T)), np.cov(rotated.T), atol=1e-12
    )


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_is_not_finite_is_not_usable(value):
    assert make_fix().usable
    assert not make_fix(position=(value, 0)).usable
    assert not make_fix(covariance=((value, 0), (0, 1))).usable
    assert not make_fix(time=value).usable
    assert not make_fix(lost=True).usable
    assert not make_fix(stale=True).usable


def test_fix_of_an_estimate():
    fix = Fix.of(make_estimate((1, 2), (0.3, 0.4)), 5.0, 7, (0, 5, 0, 5), 0.08, latency=0.01)
    assert (fix.time, fix.number, fix.latency, fix.usable) == (5.0, 7, 0.01, True)
    np.testing.assert_allclose(fix.covariance, np.diag([0.09, 0.16]))


def test_particles_all_over_the_area_are_no_position(rng):
    area = (0.0, 6.0, -2.0, 2.0)
    everywhere = rng.uniform((0, -2), (6, 2), (20000, 2))
    np.testing.assert_allclose(everywhere.std(axis=0), ignorance(area), rtol=0.02)
    knows = LOST_SHARE * ignorance(area)
    assert not Fix.of(make_estimate(spread=0.99 * knows), 0.0, 1, area, 0.08).lost
    assert Fix.of(make_estimate(spread=1.01 * knows), 0.0, 1, area, 0.08).lost
    assert Fix.of(make_estimate(lost=True), 0.0, 1, area, 0.08).lost
    assert Fix.of(make_estimate(spread=(np.nan, 0.1)), 0.0, 1, area, 0.08).lost


def test_the_largest_claim_has_a_90_percent_region_of_half_the_area(rng):
    area = (0.0, 4.0, 0.0, 4.0)
    sigma = LOST_SHARE * ignorance(area)[0]
    drawn = rng.normal(0, sigma, (20000, 2))
    radius = np.quantile(np.hypot(*drawn.T), 0.9)
    np.testing.assert_allclose(np.pi * radius**2, 0.5 * 4.0 * 4.0, rtol=0.03)


class Sent:
    """What becomes of fixes of a track, ten a second."""

    def __init__(self, **more):
        self.continuity = Continuity(lambda dt: 0.005 * dt * np.eye(2), 0.1)
        self.now, self.more = 0.0, more

    def fly(self, frames: int, position=(0.0, 0.0), **more) -> list[bool]:
        """Whether each of so many fixes is sent."""
        sent = []
        for _ in range(frames):
            fix = self.continuity.mark(make_fix(self.now, position, **self.more, **more))
            sent.append(fix.usable and fix.observed)
            self.now += 0.1
        self.resets = fix.resets
        return sent


def test_the_first_fix_goes_out_after_a_second_in_one_place():
    sent = Sent()
    assert sent.fly(12) == [False] * 9 + [True] * 3
    assert sent.resets == 0
    flickering = Sent()
    assert not any(flickering.fly(1, (5.0 * (n % 2), 0)) != [False] for n in range(40))


def test_another_place_is_held_back_until_it_has_lasted():
    """It is wrong more often than not where places look alike."""
    sent = Sent()
    sent.fly(20)
    assert sent.fly(8, (3, 0)) == [False] * 8 and sent.fly(3) == [True] * 3
    assert sent.resets == 0
    assert sent.fly(13, (3, 0)) == [False] * 9 + [True] * 4
    assert sent.resets == 1


def test_where_errors_last_longer_so_must_another_place():
    sent = Sent(measurement=Measurement(np.zeros(2), 0.04 * np.eye(2), 1.8))
    sent.fly(20)
    assert sent.fly(20, (3, 0)) == [False] * 17 + [True] * 3


def test_steps_that_the_uncertainty_allows_and_frames_that_did_not_come_hold_nothing_up():
    sent = Sent()
    sent.fly(20)
    assert [sent.fly(1, (0.1 * n, 0)) for n in range(10)] == [[True]] * 10
    sent.fly(8, (9, 9), observed=False)
    assert sent.fly(1, (1, 0)) == [True] and sent.resets == 0
    sent.now += 100.0
    assert sent.fly(1, (3, 0)) == [True]  # time allows more


def test_found_again_in_place_is_no_reset_and_is_held_back_for_a_moment_only():
    sent = Sent()
    sent.fly(20)
    sent.fly(2, (9, 9), lost=True)
    assert sent.fly(2) == [True] * 2  # a moment is no interruption
    sent.fly(10, (9, 9), lost=True)
    assert sent.fly(8) == [False] * 5 + [True] * 3 and sent.resets == 0


def test_a_camera_of_one_frame_a_second_is_followed():
    continuity = Continuity(lambda dt: 0.005 * dt * np.eye(2), 1.0)
    assert [continuity.mark(make_fix(float(t))).usable for t in range(4)] == [False] + [True] * 3


def test_errors_that_last_are_told_as_often_as_they_are_sent():
    """All reports that share an error weigh as much as one, however many are sent."""
    covariance = np.array([[0.04, 0.01], [0.01, 0.09]])
    estimate = replace(make_estimate(), measurement=Measurement(np.ones(2), covariance, 0.4))

    def told(period_s):
        fix = Fix.of(estimate, 0.0, 1, (0, 5, 0, 5), period_s)
        np.testing.assert_array_equal(fix.fusion.position, [1, 1])
        return fix.fusion.covariance

    np.testing.assert_allclose(told(0.08), 5 * covariance)
    np.testing.assert_allclose(told(0.04), 2 * told(0.08))
    np.testing.assert_allclose(told(1.0), covariance)  # seldom enough that each is news
