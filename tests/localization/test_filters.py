"""The filter against exact ones: Kalman (linear, Gaussian), a fine grid (mixture), plain loops for
its parts.
"""

import numpy as np
import pytest
from small_room import observations, random_walk, rank_mixture

from trexton.base.errors import ParameterError
from trexton.localization.filters import ParticleFilter
from trexton.localization.measurement import RankMixture
from trexton.localization.methods import ROLES, make
from trexton.localization.motion import RandomWalk
from trexton.localization.particle_parts import (
    Belief,
    HighestWeight,
    MaximumAPosteriori,
    Systematic,
    WeightedMean,
    Wheel,
)

RESAMPLERS = list(ROLES["resampling"])

PROCESS = np.array([[0.04, 0.01], [0.01, 0.03]])
MEASUREMENT = np.array([[0.25, -0.05], [-0.05, 0.2]])
AREA = (0.0, 5.0, 0.0, 5.0)


def gaussian(deviation, covariance):
    """Density of N(0, covariance) at (..., 2) deviations, written out."""
    exponent = np.einsum("...a,ab,...b->...", deviation, np.linalg.inv(covariance), deviation)
    return np.exp(-exponent / 2) / (2 * np.pi * np.sqrt(np.linalg.det(covariance)))


def make_filter(covariances, seed, particles=2000, resampling="systematic", **options):
    return ParticleFilter(
        random_walk(PROCESS),
        rank_mixture(covariances),
        AREA,
        particles,
        resampling=make("resampling", resampling),
        rng=np.random.default_rng(seed),
        **options,
    )


def seen(places):
    """An observation whose neighbours lie at these places."""
    return observations(np.array(places, dtype=float)[None])[0]


def kalman(measurements, mean, covariance):
    """Exact posterior of a random walk observed in Gaussian noise."""
    for z in measurements:
        covariance = covariance + PROCESS
        gain = covariance @ np.linalg.inv(covariance + MEASUREMENT)
        mean, covariance = mean + gain @ (z - mean), (np.eye(2) - gain) @ covariance
    return mean, covariance


@pytest.mark.parametrize("resampling", RESAMPLERS)
def test_agrees_with_the_kalman_filter_within_standard_errors(resampling):
    rng = np.random.default_rng(5)
    truth = np.array([2.5, 2.5]) + np.cumsum(rng.multivariate_normal([0, 0], PROCESS, 12), axis=0)
    measurements = truth + rng.multivariate_normal([0, 0], MEASUREMENT, 12)
    prior = np.diag([0.3, 0.3])
    mean, covariance = kalman(measurements, np.array([2.5, 2.5]), prior)
    found = []
    for seed in range(60):
        particle_filter = make_filter(MEASUREMENT[None], seed, 800, resampling)
        start = np.random.default_rng([seed, 1]).multivariate_normal([2.5, 2.5], prior, 800)
        particle_filter.belief = Belief(start, np.full(800, 1 / 800), np.zeros(800))
        for z in measurements:
            particle_filter.step(seen(z[None]))
        estimate, spread = particle_filter.moments()
        found.append([*estimate, spread[0, 0], spread[0, 1], spread[1, 1]])
    found = np.array(found)
    exact = np.array([*mean, covariance[0, 0], covariance[0, 1], covariance[1, 1]])
    standard_error = found.std(axis=0, ddof=1) / np.sqrt(len(found))
    # Four standard errors, plus the O(1/M) bias that any finite particle set has.
    assert (np.abs(found.mean(axis=0) - exact) < 4 * standard_error + 2 / 800).all()
    # One run with 800 particles is close as well, or the mean over many would prove little.
    assert (found.std(axis=0) < 0.05).all()


def test_agrees_with_a_grid_filter_for_the_mixture():
    covariances = np.stack([np.diag([0.2, 0.25]), np.array([[0.3, 0.1], [0.1, 0.4]])])
    measurements = [np.array([[1.2, 3.5], [3.8, 1.4]]), np.array([[3.6, 1.5], [1.3, 3.4]])]
    axis = np.linspace(-2, 7, 226)
    grid = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1)
    cell = axis[1] - axis[0]
    density = ((grid >= 0) & (grid <= 5)).all(axis=-1).astype(float)
    offsets = np.arange(-25, 26) * cell
    kernel = gaussian(np.stack(np.meshgrid(offsets, offsets, indexing="ij"), axis=-1), PROCESS)
    from scipy.signal import fftconvolve

    for z in measurements:
        density = fftconvolve(density, kernel, mode="same") * sum(
            gaussian(z[j] - grid, covariances[j]) for j in range(2)
        )
        density = np.maximum(density, 0) / density.sum()
    exact_mean = (density[..., None] * grid).sum(axis=(0, 1))
    exact_share = density[grid[..., 0] > 2.5].sum()
    found = []
    for seed in range(50):
        particle_filter = make_filter(covariances, seed, 3000)
        for z in measurements:
            belief = particle_filter.step(seen(z))
        found.append(
            [*particle_filter.moments()[0], belief.weights[belief.states[:, 0] > 2.5].sum()]
        )
    found = np.array(found)
    error = np.abs(found.mean(axis=0) - [*exact_mean, exact_share])
    assert (error < 4 * found.std(axis=0, ddof=1) / np.sqrt(len(found)) + 0.003).all()
    assert 0.1 < exact_share < 0.9  # both modes matter, else this tests little


def test_the_mixture_equals_the_plain_sum():
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(5, 2, 2))
    covariances = roots @ roots.transpose(0, 2, 1) + 0.1 * np.eye(2)
    particles, z = rng.uniform(0, 5, (40, 2)), rng.uniform(0, 5, (5, 2))
    plain = [
        sum(gaussian(z[j] - particle, covariances[j]) for j in range(5)) for particle in particles
    ]
    np.testing.assert_allclose(
        rank_mixture(covariances).mixture(particles, z), np.log(plain), rtol=1e-10
    )


def test_the_predictive_equals_the_plain_double_sum():
    rng = np.random.default_rng(1)
    particles, previous = rng.normal(2, 0.3, (30, 2)), rng.normal(2, 0.3, (30, 2))
    weights = rng.dirichlet(np.ones(30))
    plain = [
        sum(w * gaussian(x - y, PROCESS) for y, w in zip(previous, weights, strict=False))
        for x in particles
    ]
    found = random_walk(PROCESS).density(particles, previous, weights)
    constant = np.log(2 * np.pi * np.sqrt(np.linalg.det(PROCESS)))
    np.testing.assert_allclose(found - constant, np.log(plain), rtol=1e-9)


def test_the_map_estimate_is_the_best_of_the_plain_scores():
    rng = np.random.default_rng(2)
    particles, previous = rng.uniform(0, 2, (25, 2)), rng.uniform(0, 2, (25, 2))
    before, now = rng.dirichlet(np.ones(25)), rng.dirichlet(np.ones(25))
    likelihood = rng.random(25)
    score = [
        likelihood[i]
        * sum(w * gaussian(x - y, PROCESS) for y, w in zip(previous, before, strict=False))
        for i, x in enumerate(particles)
    ]
    belief = Belief(particles, now, np.log(likelihood))
    walk = random_walk(PROCESS)
    past = Belief(previous, before, np.zeros(25))
    estimate = MaximumAPosteriori().position(belief, past, walk)
    np.testing.assert_array_equal(estimate, particles[np.argmax(score)])
    np.testing.assert_array_equal(
        HighestWeight().position(belief, None, walk), particles[np.argmax(now)]
    )
    np.testing.assert_allclose(
        WeightedMean().position(belief, None, walk), (now[:, None] * particles).sum(axis=0)
    )


def walked_wheel(weights, rng):
    """The resampling wheel as it is usually told: step by step."""
    index = int(rng.integers(len(weights)))
    steps = rng.random(len(weights)) * 2 * weights.max()
    beta, drawn = 0.0, []
    for step in steps:
        beta += step
        while weights[index] < beta:
            beta -= weights[index]
            index = (index + 1) % len(weights)
        drawn.append(index)
    return drawn


@pytest.mark.parametrize("seed", range(20))
def test_the_wheel_draws_what_walking_it_draws(seed):
    weights = np.random.default_rng([seed, 1]).dirichlet(np.full(50, 0.2))
    drawn = Wheel().indices(weights, np.random.default_rng(seed))
    np.testing.assert_array_equal(drawn, walked_wheel(weights, np.random.default_rng(seed)))


@pytest.mark.parametrize("name", RESAMPLERS)
def test_counts_follow_the_weights(name):
    weights = np.random.default_rng(3).dirichlet(np.ones(40))
    resampler, rng, trials = make("resampling", name), np.random.default_rng(4), 4000
    counts = np.stack(
        [np.bincount(resampler.indices(weights, rng), minlength=40) for _ in range(trials)]
    )
    # The wheel starts at the edge of a particle, not anywhere on it: a bias of a few hundredths of
    # a draw.
    slack = 0.06 if name == "wheel" else 0
    standard_error = np.maximum(counts.std(axis=0, ddof=1), np.sqrt(40 * weights)) / np.sqrt(trials)
    assert (np.abs(counts.mean(axis=0) - 40 * weights) < 4.5 * standard_error + slack).all()


def test_systematic_counts_are_within_one():
    weights = np.random.default_rng(6).dirichlet(np.full(64, 0.3))
    counts = np.bincount(Systematic().indices(weights, np.random.default_rng(7)), minlength=64)
    assert (np.abs(counts - 64 * weights) < 1).all()


def test_permuting_particles_changes_nothing():
    rng = np.random.default_rng(8)
    particles, previous = rng.uniform(0, 5, (60, 2)), rng.uniform(0, 5, (60, 2))
    covariances = np.stack([MEASUREMENT, 2 * MEASUREMENT])
    z, order = rng.uniform(0, 5, (2, 2)), rng.permutation(60)
    mixture, motion = rank_mixture(covariances), random_walk(PROCESS)
    results = []
    for p in (particles, particles[order]):
        log_likelihood = mixture.mixture(p, z)
        weights = np.exp(log_likelihood) / np.exp(log_likelihood).sum()
        belief = Belief(p, weights, log_likelihood)
        before = Belief(previous, np.full(60, 1 / 60), np.zeros(60))
        results.append(
            [kind().position(belief, before, motion) for kind in (MaximumAPosteriori, WeightedMean)]
        )
    np.testing.assert_allclose(results[0], results[1], rtol=1e-12)


def test_a_missing_measurement_only_predicts():
    particle_filter = make_filter(MEASUREMENT[None], 9, 5000)
    particle_filter.step(seen([[2.0, 3.0]]))
    mean, covariance = particle_filter.moments()
    belief = particle_filter.step(None)
    after, grown = particle_filter.moments()
    assert not belief.lost and np.ptp(belief.weights) == 0
    np.testing.assert_allclose(after, mean, atol=0.05)
    np.testing.assert_allclose(grown - covariance, PROCESS, atol=0.03)
    assert np.isfinite(particle_filter.position()).all()


def test_vanished_weights_start_again_and_say_lost():
    particle_filter = make_filter(np.diag([1e-4, 1e-4])[None], 10, 200)
    belief = particle_filter.step(seen([[1e4, 1e4]]))
    assert belief.lost and np.isfinite(particle_filter.position()).all()
    assert particle_filter.moments()[1][0, 0] > 1  # spread over the whole area again
    for _ in range(20):
        belief = particle_filter.step(seen([[2.0, 2.0]]))
    assert not belief.lost
    np.testing.assert_allclose(particle_filter.position(), [2, 2], atol=0.3)


def test_equal_seeds_give_equal_bits():
    def track():
        particle_filter = make_filter(MEASUREMENT[None], 11, 50, "wheel")
        return [
            tuple(particle_filter.step(seen([[2.0, i / 10]])).states.ravel()) for i in range(10)
        ]

    assert track() == track()


@pytest.mark.parametrize(
    "build",
    [
        lambda: random_walk(np.zeros((2, 2))),
        lambda: random_walk(np.full((2, 2), np.nan)),
        lambda: random_walk(np.eye(2), 0.0),
        lambda: RandomWalk(sigma=-1.0),
        lambda: rank_mixture(np.eye(2)),
        lambda: rank_mixture(np.array([[[1.0, 2.0], [2.0, 1.0]]])),
        lambda: RankMixture(neighbors=0),
        lambda: RankMixture(sigma=0.0),
        lambda: RankMixture(excluded_s=-1.0),
        lambda: make_filter(MEASUREMENT[None], 0, 0),
        lambda: make_filter(MEASUREMENT[None], 0, 5, "roulette"),
        lambda: make("estimation", "median"),
        lambda: make_filter(MEASUREMENT[None], 0, 5).step(seen(np.zeros((3, 2)))),
    ],
)
def test_bad_parameters_are_one_clear_error(build):
    with pytest.raises(ParameterError, match="expected|choose"):
        build()


@pytest.mark.parametrize("width", [0.05, 0.4, 3.0, 300.0])
@pytest.mark.parametrize("informed", [0.1, 10.0])
@pytest.mark.parametrize("count, times", [(600, 2), (1600, 2)])
def test_states_that_bounds_leave_out_could_not_have_won(rng, width, informed, count, times):
    motion = random_walk(np.array([[0.04, 0.01], [0.01, 0.09]]))
    for _ in range(times):
        previous = width * (7 + 0.2 * rng.standard_normal((count, 2)))
        weights = rng.dirichlet(np.full(count, 0.3))
        states = motion.sample(previous[rng.choice(count, count, p=weights)], rng)
        scores = -informed * np.square(states - width * 7.1).sum(axis=1)
        density = motion.density(states, previous, weights)
        assert motion.likeliest(scores, states, previous, weights) == np.argmax(scores + density)
        for bounds in (motion._binned, motion._single):
            assert (bounds(states, previous, weights) >= density).all()


def test_weights_sum_to_one_and_the_mean_likelihood_is_that_of_the_particles():
    particle_filter = make_filter([MEASUREMENT], seed=4, particles=50)
    assert particle_filter.belief.weights.tolist() == [1 / 50] * 50
    assert particle_filter.step(None).weights.tolist() == [1 / 50] * 50
    belief = particle_filter.step(seen([[2.0, 2.0]]))
    assert belief.weights.sum() == pytest.approx(1)
    mean = np.log(np.exp(belief.log_likelihood).mean())
    assert belief.log_mean_likelihood == pytest.approx(mean)
