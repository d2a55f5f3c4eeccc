"""Metrics against plain definitions and known coverage."""

import numpy as np
import pytest

from trexton.companion.experiments.evaluation import constant_guess, shuffled_neighbors
from trexton.companion.experiments.metrics import block_rows, euclidean, summarize
from trexton.companion.experiments.rates import mean_over_groups, success_rate, wilson_interval


def test_summary_of_one_run_equals_the_plain_definitions(rng):
    truth = rng.uniform(0, 5, (200, 2))
    estimate = truth + rng.normal(0, [0.3, 0.6], (200, 2))
    found = summarize([estimate], truth, 10.0, rng=rng, draws=50)
    absolute = 100 * np.abs(estimate - truth)
    euclidean = [100 * float(np.linalg.norm(e - t)) for e, t in zip(estimate, truth, strict=False)]
    expected = {
        "error_cm_x": sum(absolute[:, 0]) / 200,
        "error_cm_y": sum(absolute[:, 1]) / 200,
        "std_cm_y": (sum((absolute[:, 1] - absolute[:, 1].mean()) ** 2) / 200) ** 0.5,
        "mean_cm": sum(euclidean) / 200,
        "median_cm": (sorted(euclidean)[99] + sorted(euclidean)[100]) / 2,
        "rmse_cm": (sum(e * e for e in euclidean) / 200) ** 0.5,
        "relative": sum(euclidean) / 200 / 1000,
    }
    for name, value in expected.items():
        assert found[name]["value"] == pytest.approx(value), name
        assert found[name]["low"] < value < found[name]["high"], name
    assert found["frames"] == 200 and found["missing"] == 0


def test_nothing_is_aligned():
    truth = np.zeros((50, 2))
    found = summarize([truth + [1.0, 0.0]], truth, 1.0, rng=np.random.default_rng(0), draws=10)
    assert found["error_cm_x"]["value"] == pytest.approx(100)  # a constant offset is an error


def test_missing_frames_are_counted_and_left_out(rng):
    truth = rng.uniform(0, 5, (60, 2))
    estimate = truth + 0.1
    estimate[10:25] = np.nan
    found = summarize([estimate], truth, 5.0, rng=rng, draws=50)
    assert found["missing"] == 15 and found["frames"] == 45
    assert found["error_cm_x"]["value"] == pytest.approx(10)
    nothing = summarize([np.full((60, 2), np.nan)], truth, 5.0, rng=rng)
    assert nothing == {"runs": 1, "frames": 0, "missing": 60}


def test_the_value_is_the_median_over_runs(rng):
    truth = np.zeros((40, 2))
    runs = [np.full((40, 2), offset) for offset in (0.1, 0.2, 0.9)]
    found = summarize(runs, truth, 5.0, rng=rng, draws=200)["error_cm_y"]
    assert found["value"] == pytest.approx(20)
    assert found["low"] == pytest.approx(10) and found["high"] == pytest.approx(90)


def test_block_intervals_cover_where_independent_ones_would_not():
    """Errors that follow a slow AR(1): blocks must cover the true mean far more often than single
    frames do.
    """
    covered = {1: 0, 24: 0}
    for trial in range(80):
        rng = np.random.default_rng([1, trial])
        noise = rng.normal(size=600)
        series = np.empty(600)
        series[0] = noise[0] / np.sqrt(1 - 0.9**2)
        for i in range(1, 600):
            series[i] = 0.9 * series[i - 1] + noise[i]
        for block in covered:
            means = [series[block_rows(600, rng, block)].mean() for _ in range(200)]
            low, high = np.percentile(means, (2.5, 97.5))
            covered[block] += low <= 0 <= high
    assert covered[24] >= 0.78 * 80  # nominal 95 %, a little less with blocks of finite length
    assert covered[1] < 0.6 * 80


def test_block_rows_keep_neighbours_together(rng):
    rows = block_rows(100, rng, 10)
    assert len(rows) == 100
    assert np.mean((np.diff(rows) % 100) == 1) >= 0.89
    assert len(block_rows(5, rng, 12)) == 5


def test_yardsticks(rng):
    positions = rng.uniform(0, 4, (30, 2))
    np.testing.assert_allclose(
        constant_guess(positions, 7), np.tile(positions.mean(axis=0), (7, 1))
    )
    shuffled = shuffled_neighbors(positions, 4000, 5, rng=rng)
    assert shuffled.shape == (4000, 2)
    np.testing.assert_allclose(shuffled.mean(axis=0), positions.mean(axis=0), atol=0.06)


def test_wilson_interval_of_four_in_six():
    low, high = wilson_interval(4, 6)
    assert (round(low, 3), round(high, 3)) == (0.300, 0.903)  # published tables


@pytest.mark.parametrize(("good", "trials"), [(0, 1), (0, 9), (9, 9), (4, 6), (31, 200)])
def test_wilson_interval_is_scipys_and_that_of_clusters_of_one(good, trials):
    from scipy.stats import binomtest

    scipy = tuple(binomtest(good, trials).proportion_ci(method="wilson"))
    assert wilson_interval(good, trials) == pytest.approx(scipy, rel=1e-12, abs=0)
    if trials > 1:
        alone = wilson_interval(np.arange(trials) < good, np.ones(trials, int))
        assert alone == pytest.approx(scipy, rel=1e-12, abs=0)


def test_trials_that_are_alike_in_a_cluster_count_as_fewer():
    together = wilson_interval(20, 40)
    half = wilson_interval([20, 0, 20, 0] * 5, [20] * 20)
    assert half[0] < wilson_interval(10, 20)[0] and half[1] > wilson_interval(10, 20)[1]
    for even in ([5] * 4, [6, 4, 5, 5]):  # less unlike than by chance: no surer for that
        low, high = wilson_interval(even, [10] * 4)
        assert low < together[0] and together[1] < high
    many = wilson_interval([5] * 400, [10] * 400)
    assert many == pytest.approx(wilson_interval(2000, 4000), abs=1e-4)


def test_few_clusters_do_not_pretend_to_know():
    assert wilson_interval([19], [20]) == (0, 1)
    assert wilson_interval([20, 20, 20], [20, 20, 20]) == wilson_interval(3, 3)
    assert wilson_interval([20, 0, 20], [20, 0, 20]) == wilson_interval(2, 2)
    low, high = wilson_interval([19, 18], [20, 20])
    assert low < 0.3 and high > 0.99
    assert success_rate([19, 18, 0], [20, 20, 0]) == {
        "value": 0.925, "low": low, "high": high, "trials": 40, "clusters": 2,
    }  # fmt: skip
    assert success_rate([0, 0], [0, 0]) is None


def test_mean_over_groups_is_students():
    found = mean_over_groups([1.0, 2.0, 3.0])
    assert found["value"] == 2
    assert found["high"] == pytest.approx(2 + 4.302653 / 3**0.5)  # t of two degrees, tabled
    assert found["low"] == 0  # what cannot be negative
    assert mean_over_groups([0.8, 1.0], highest=1)["high"] == 1
    assert mean_over_groups([1.5]) == {"value": 1.5, "low": None, "high": None}


@pytest.mark.parametrize("count", [2, 5, 17, 25])
def test_a_short_flight_has_an_interval_of_some_width(rng, count):
    truth = np.zeros((count, 2))
    found = summarize([rng.normal(0, 0.3, (count, 2))], truth, 5.0, rng=rng)["mean_cm"]
    assert found["low"] < found["value"] < found["high"]


def test_distances_are_those_of_pythagoras():
    places = np.array([[0.0, 0.0], [3.5, -1.0]])
    np.testing.assert_allclose(euclidean(places, np.array([3.0, 4.0])), [5, np.hypot(0.5, 5)])
