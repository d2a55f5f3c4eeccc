"""Statistics that could fail: exact answers, coverage, and properties that hold for any input."""

import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import small_flight
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from small_room import observations, random_walk, rank_mixture

from trexton.companion.experiments.floors import mean_over_floors
from trexton.companion.experiments.metrics import block_rows, summarize, with_interval
from trexton.companion.experiments.rates import wilson_interval
from trexton.companion.experiments.similarity import local_losses
from trexton.companion.experiments.sweeps import TreeSearch
from trexton.flights.folder import read_flight
from trexton.flights.writing import write_flight
from trexton.localization.estimate import Estimate
from trexton.localization.filters import ParticleFilter
from trexton.localization.landing import LandingZone
from trexton.localization.methods import ROLES, make
from trexton.localization.neighbors import NearestHistograms
from trexton.localization.particle_parts import Systematic

PROCESS, NOISE = np.diag([0.02, 0.03]), np.diag([0.1, 0.06])
AREA = (0.0, 4.0, 0.0, 3.0)

few = settings(
    max_examples=60, deadline=None, derandomize=True, database=None,
    suppress_health_check=[HealthCheck.too_slow],
)  # fmt: skip
seeds = st.integers(0, 2**32 - 1)


def toy(seed, particles=600, steps=8):
    """A vehicle and a filter that both obey the same model, from a uniform start: what it
    claims of the last place (mean, covariance), that place, and the measurements."""
    rng = np.random.default_rng(seed)
    low, high = np.array(AREA).reshape(2, 2).T
    places = rng.uniform(low, high) + np.vstack(
        [np.zeros(2), np.cumsum(rng.multivariate_normal([0, 0], PROCESS, steps), axis=0)]
    )
    seen = places[1:] + rng.multivariate_normal([0, 0], NOISE, steps)
    tracker = ParticleFilter(
        random_walk(PROCESS), rank_mixture(NOISE[None]), AREA, particles,
        resampling=Systematic(), rng=rng,
    )  # fmt: skip
    for observation in observations(seen[:, None]):
        tracker.step(observation)
    mean, covariance = tracker.moments()
    return mean, covariance, places[-1], seen


def grid_posterior(seen, low, high, process, noise, cell=0.02):
    """Mean and variance along one axis, by Bayes' rule on a grid: uniform start, walk, look."""
    axis = np.arange(low - 2, high + 2, cell)
    belief = ((axis >= low) & (axis <= high)).astype(float)
    offsets = np.arange(-60, 61) * cell
    walk = np.exp(-(offsets**2) / (2 * process))
    for z in seen:
        belief = np.convolve(belief, walk, mode="same") * np.exp(-((z - axis) ** 2) / (2 * noise))
        belief /= belief.sum()
    mean = belief @ axis
    return mean, belief @ (axis - mean) ** 2


def test_from_a_uniform_start_it_agrees_with_a_grid():
    """The axes are independent here, so a grid of one dimension each is exact."""
    for seed in (7, 8, 9):
        mean, covariance, _, seen = toy(seed, 4000)
        for i in range(2):
            exact, variance = grid_posterior(
                seen[:, i], AREA[2 * i], AREA[2 * i + 1], PROCESS[i, i], NOISE[i, i]
            )
            # A mean of 4000 particles, which resampling makes a few times less sure.
            assert abs(mean[i] - exact) < 10 * np.sqrt(variance / 4000)
            assert covariance[i, i] == pytest.approx(variance, rel=0.2)


def test_nees_is_in_its_band_where_the_model_is_true_and_out_of_it_where_it_is_not():
    """e' P^-1 e of a true filter is chi-squared with two degrees of freedom."""
    from scipy.stats import chi2

    trials = 200
    nees = np.empty(trials)
    for seed in range(trials):
        mean, covariance, truth, _ = toy(seed)
        nees[seed] = (truth - mean) @ np.linalg.solve(covariance, truth - mean)
    low, high = chi2.ppf((0.0005, 0.9995), 2 * trials) / trials
    assert low < nees.mean() < high
    assert abs((nees <= chi2.ppf(0.95, 2)).mean() - 0.95) < 3.5 * np.sqrt(0.95 * 0.05 / trials)
    # The band is narrow enough to refuse a claim that is wrong by a third.
    assert not low < nees.mean() * 1.33**2 < high and not low < nees.mean() / 1.33**2 < high


@pytest.mark.parametrize("frames", [300, 420])
def test_printed_intervals_of_errors_hold_what_they_say(frames):
    """95 % intervals of independent errors hold the true mean in 93 to 97 of a hundred flights.

    Of flights as long as the real one and the simulated one.
    """
    sigma, trials, draws = 10.0, 3000, 1000
    true = sigma * np.sqrt(np.pi / 2)  # the mean of Rayleigh's distribution
    rng = np.random.default_rng(3)
    errors = rng.normal(0, sigma, (trials, frames, 2))
    weights, again = np.empty((draws, frames)), np.random.default_rng(4)
    for draw in range(draws):
        again.integers(1)  # which of the runs: there is one
        weights[draw] = np.bincount(block_rows(frames, again), minlength=frames) / frames
    drawn = weights @ np.hypot(*np.moveaxis(errors, 2, 0)).T
    _, low, high = with_interval(0.0, drawn, frames).values()
    # These are the intervals that are printed.
    printed = summarize(
        [errors[0] / 100], np.zeros((frames, 2)), 5.0, rng=np.random.default_rng(4)
    )["mean_cm"]
    np.testing.assert_allclose((low[0], high[0]), (printed["low"], printed["high"]))
    assert 0.945 <= ((low <= true) & (true <= high)).mean() <= 0.965


def test_an_interval_of_few_blocks_is_as_wide_as_students():
    """Of normal means the expanded percentiles are those of Student's t."""
    from scipy.stats import norm, t

    drawn = norm.ppf((np.arange(100_000) + 0.5) / 100_000)
    for blocks in (5, 20, 100):
        _, low, high = with_interval(0.0, drawn, 12 * blocks).values()
        wide = t.isf(0.025, blocks - 1) * np.sqrt(blocks / (blocks - 1))
        assert -low == pytest.approx(wide, rel=0.01) and high == pytest.approx(wide, rel=0.01)
    _, *ends = with_interval(0.0, [1.0, 2.0, np.nan], 3).values()
    assert ends == pytest.approx([1, 2])  # all there is


@pytest.mark.parametrize("rate", [0.1, 0.5, 0.93])
def test_intervals_of_success_rates_hold_what_they_say(rate):
    """Exactly, by the weights of the binomial distribution, on average over numbers of trials."""
    from scipy.stats import binom

    coverage = []
    for trials in range(40, 80, 3):
        counts = np.arange(trials + 1)
        inside = [low <= rate <= high for low, high in (wilson_interval(k, trials) for k in counts)]
        coverage.append(binom.pmf(counts, trials, rate)[inside].sum())
    assert 0.93 <= np.mean(coverage) <= 0.97


@pytest.mark.parametrize(
    ("floors", "alike", "rate", "least", "plain"),
    [
        (10, 0, 0.5, 0.95, 0.97), (10, 0.05, 0.8, 0.94, 0.9), (10, 0.2, 0.5, 0.94, 0.7),
        (10, 0.7, 0.5, 0.94, 0.5), (10, 0.95, 0.5, 0.94, 0.3), (10, 0.2, 0.9, 0.93, 0.7),
        (10, 0.7, 0.9, 0.86, 0.5),  # the worst
        (3, 0.2, 0.8, 0.95, 0.7), (3, 0.95, 0.8, 0.95, 0.3), (2, 0.2, 0.8, 0.99, 0.7),
    ],
)  # fmt: skip
def test_intervals_of_clustered_rates_hold_what_they_say(floors, alike, rate, least, plain):
    """Of 20 flights over each floor, whose own rates are beta-distributed: `alike` is the
    correlation of two flights over one floor. Wilson's interval of all flights holds far less.
    """
    rng, trials = np.random.default_rng(5), 2000
    own = np.full((trials, floors), rate)
    if alike:
        shape = (1 - alike) / alike
        own = rng.beta(rate * shape, (1 - rate) * shape, own.shape)
    counts = rng.binomial(20, own)

    def held(intervals):
        return np.mean([low <= rate <= high for low, high in intervals])

    assert held(wilson_interval(good, [20] * floors) for good in counts) >= least
    assert held(wilson_interval(int(good.sum()), 20 * floors) for good in counts) <= plain


@pytest.mark.parametrize(
    ("floors", "shape", "least"), [(10, 1000, 0.94), (4, 1000, 0.94), (10, 2, 0.91), (4, 2, 0.9)]
)
def test_intervals_over_floors_hold_what_they_say(floors, shape, least):
    """Of flights over so many floors, whose own mean errors are gamma-distributed: nearly normal,
    or most small and few large. Errors last within a flight, so frames are no units.
    """
    rng, trials, true = np.random.default_rng(7), 3000, 10.0
    own = rng.gamma(shape, true / shape, (trials, floors, 1))
    lasting = np.repeat(3 * rng.standard_normal((trials, floors, 25)), 8, axis=2)
    flights = own + lasting
    found = [mean_over_floors(rows, rng, -np.inf) for rows in flights]
    held = np.mean([each["low"] <= true <= each["high"] for each in found])
    assert least <= held <= 0.965
    # As if frames were units.
    reach = 1.96 * flights.std(axis=(1, 2)) / np.sqrt(floors * 200)
    assert (np.abs(flights.mean(axis=(1, 2)) - true) < reach).mean() < 0.6


@few
@given(seeds, st.integers(2, 60), st.sampled_from(sorted(ROLES["resampling"])))
def test_resamplers_draw_as_many_as_they_had_and_nobody_without_weight(seed, count, name):
    rng = np.random.default_rng(seed)
    weights = rng.dirichlet(np.full(count, 0.3)) * (rng.random(count) < 0.7)
    weights[rng.integers(count)] += 0.01
    weights /= weights.sum()
    drawn = make("resampling", name).indices(weights, rng)
    assert len(drawn) == count and (weights[drawn] > 0).all()


@few
@given(seeds, st.integers(2, 150), st.integers(1, 6), st.integers(1, 12))
def test_methods_of_search_agree_under_ties(seed, rows, textons, k):
    rng = np.random.default_rng(seed)
    table = rng.integers(0, 3, (rows, textons)) / 4  # full of equal rows
    places, k = rng.normal(size=(rows, 2)), min(k, rows)
    brute, tree = (search(table, places, k) for search in (NearestHistograms, TreeSearch))
    for query in rng.integers(0, 3, (4, textons)) / 4:
        one, other = brute.query(query), tree.query(query)
        order = np.lexsort((np.arange(rows), ((table - query) ** 2).sum(axis=1)))[:k]
        assert one.index.tolist() == other.index.tolist() == order.tolist()
        assert one.distance.tobytes() == other.distance.tobytes()


metres = st.floats(-1e6, 1e6, allow_subnormal=False)


@few
@given(
    st.lists(st.tuples(metres, metres), min_size=2, max_size=8),
    st.floats(1e-3, 1e3),
    st.text("abc äß\"'\\#=", min_size=1, max_size=8).map(str.strip).filter(bool),
)
def test_any_flight_reads_back_as_it_was_written(places, period, name):
    count = len(places)
    flight = replace(
        small_flight(count), name=name, position=np.array(places), split={},
        time=np.arange(count) * period,
    )  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        again = read_flight(write_flight(flight, Path(folder) / "flight"))
    np.testing.assert_array_equal(again.position, flight.position)
    np.testing.assert_array_equal(again.time, flight.time)
    assert again.name == flight.name and again.data_hash == flight.data_hash


@few
@given(seeds, st.integers(1, 40), st.integers(2, 8), st.floats(0.05, 5.0))
def test_the_loss_of_a_map_has_bounds(seed, count, textons, sigma):
    """Similarities and ideals lie between 0 and 1, and both are 1 of a sample with itself."""
    rng = np.random.default_rng(seed)
    histograms = rng.dirichlet(np.full(textons, 0.5), count)
    places = rng.uniform(-3, 3, (count, 2))
    most = (count - 1) / count + 1e-9
    losses = local_losses(histograms, places, sigma)
    assert (np.abs(losses) <= most).all()
    assert abs(losses.mean()) <= most
    # A wider ideal asks for more likeness: what exceeds it can only shrink.
    assert local_losses(histograms, places, 2 * sigma).mean() <= losses.mean()


lengths = st.floats(0.05, 3.0)


@few
@given(st.tuples(metres, metres), lengths, lengths, lengths, lengths, seeds)
def test_the_landing_trigger_is_monotone_in_radius_and_spread(
    center, radius, wider, theta, looser, seed
):
    """A larger circle or a looser threshold never refuses what a smaller one accepts."""
    rng = np.random.default_rng(seed)
    for _ in range(5):
        guess = Estimate(
            np.array(center) + rng.normal(scale=radius, size=2),
            np.diag(rng.uniform(0, 2 * theta, 2) ** 2),
        )
        if LandingZone(center, radius, theta).accepts(guess):
            assert LandingZone(center, radius + wider, theta).accepts(guess)
            assert LandingZone(center, radius, theta + looser).accepts(guess)
            assert LandingZone(center, radius + wider, theta + looser).accepts(guess)
