"""The map loss against the double loop and against cases worked out by hand."""

import numpy as np
import pytest

from trexton.base.errors import MapError, ParameterError
from trexton.companion.experiments.similarity import (
    cosine_similarity,
    heat_map,
    ideal_similarity,
    local_losses,
    smooth,
)


def global_loss(histograms, positions, sigma):
    return local_losses(histograms, positions, sigma).mean()


def printed_loss(histograms, positions, sigma_x, sigma_y):
    """L(D) as the paper prints it: every term of the double sum, one by one."""
    total, local = 0.0, []
    for h_i, (x_i, y_i) in zip(histograms, positions, strict=False):
        row = 0.0
        for h_j, (x_j, y_j) in zip(histograms, positions, strict=False):
            similarity = (h_i @ h_j) / (np.linalg.norm(h_i) * np.linalg.norm(h_j))
            f_x = np.exp(-((x_i - x_j) ** 2) / (2 * sigma_x**2))
            f_y = np.exp(-((y_i - y_j) ** 2) / (2 * sigma_y**2))
            row += similarity - f_x * f_y
        total += row
        local.append(row / len(histograms))
    return total / len(histograms) ** 2, local


@pytest.mark.parametrize("sigma", [0.8, 1.7])
def test_loss_equals_double_loop(rng, sigma):
    histograms, positions = rng.dirichlet(np.ones(20), 60), rng.uniform(0, 5, (60, 2))
    total, local = printed_loss(histograms, positions, sigma, sigma)
    assert global_loss(histograms, positions, sigma) == pytest.approx(total, abs=1e-12)
    np.testing.assert_allclose(local_losses(histograms, positions, sigma), local, atol=1e-12)


def test_more_rows_than_a_block(rng):
    histograms, positions = rng.dirichlet(np.ones(3), 700), rng.uniform(0, 5, (700, 2))
    direct = (cosine_similarity(histograms) - ideal_similarity(positions, positions, 0.8)).mean(
        axis=1
    )
    np.testing.assert_allclose(local_losses(histograms, positions, 0.8), direct, atol=1e-12)


def test_alike_in_one_place_costs_nothing():
    assert global_loss(np.tile([0.5, 0.3, 0.2], (7, 1)), np.ones((7, 2)), 0.8) == pytest.approx(
        0, abs=1e-12
    )


def test_alike_far_apart():
    # Two samples: the diagonal is 1 - 1, the others 1 - exp(-d^2 / 2 sigma^2); half of all terms.
    histograms, positions = [[0.2, 0.8], [0.2, 0.8]], [[0.0, 0.0], [1.2, 1.6]]
    assert global_loss(histograms, positions, 1.0) == pytest.approx((1 - np.exp(-2.0)) / 2)
    assert global_loss(histograms, [[0, 0], [1000, 0]], 1.0) == pytest.approx(0.5)


def test_unlike_in_one_place_lowers_the_loss():
    # Orthogonal histograms at one place: two terms 1 - 1 and two terms 0 - 1.
    assert global_loss(np.eye(2), np.zeros((2, 2)), 0.8) == pytest.approx(-0.5)
    assert global_loss(np.eye(2), [[0, 0], [1000, 0]], 0.8) == pytest.approx(0, abs=1e-12)


def test_scale_of_histograms_does_not_matter(rng):
    histograms, positions = rng.dirichlet(np.ones(5), 9), rng.uniform(0, 1, (9, 2))
    counts = histograms * rng.uniform(1, 400, (9, 1))
    assert global_loss(counts, positions, 0.5) == pytest.approx(
        global_loss(histograms, positions, 0.5)
    )


def test_similarity_bounds(rng):
    similarity = cosine_similarity(rng.dirichlet(np.full(20, 0.1), 100))
    assert similarity.min() >= 0 and similarity.max() <= 1 + 1e-12
    np.testing.assert_allclose(np.diagonal(similarity), 1)


def test_smooth_by_hand():
    positions = np.array([[0.0, 0.0], [1.0, 0.0]])
    weight = np.exp(-0.5)
    smoothed = smooth(np.array([10.0, 20.0]), positions, np.array([[0.0, 0.0], [0.5, 3.0]]), 1.0)
    np.testing.assert_allclose(smoothed, [(10 + 20 * weight) / (1 + weight), 15])


def test_heat_map_by_hand():
    # Cells of 5 cm around (2.5, 2.5), (7.5, 2.5), (12.5, 2.5) cm and the row above; samples in two
    # of them.
    positions, values = 0.05 * np.array([[0.5, 0.5], [2.5, 0.5]]), np.array([1.0, 3.0])
    heat = heat_map(values, positions, (0, 0.15, 0, 0.1), 0.05 * 1.0001)
    near, far = 1.0, np.exp(-2.0)
    left = (near * 1 + far * 3) / (near + far)
    # In the upper row both weights shrink alike and their mean stays; its middle cell is 7 cm
    # from both.
    expected = [[left, 2.0, 4 - left], [left, np.nan, 4 - left]]
    np.testing.assert_allclose(heat, expected, rtol=1e-3)
    assert np.isnan(heat_map(values, positions, (0, 0.15, 0, 0.1), 0.045)[:, 1]).all()


def test_heat_map_of_a_field_is_as_coarse_as_it_must():
    values, place = np.ones(1), np.array([[2.0, 2.0]])
    assert heat_map(values, place, (0, 5, 0, 4), 0.8).shape == (80, 100)  # 5 cm
    assert heat_map(values, place, (0, 430, 0, 415), 0.8).shape == (194, 200)


def test_heat_map_fills_the_area_with_whole_cells():
    heat = heat_map(np.ones(1), np.array([[0.1, 0.1]]), (0, 0.2, 0, 0.11), 10.0)
    assert heat.shape == (3, 4)
    np.testing.assert_allclose(heat, 1)


def test_zero_histogram_is_named():
    with pytest.raises(MapError, match="row 1 the first"):
        local_losses([[1, 0], [0, 0], [0, 0]], np.zeros((3, 2)), 0.8)
    with pytest.raises(MapError, match="not finite"):
        cosine_similarity([[1, np.nan]])


@pytest.mark.parametrize("sigma", [0, -1, np.nan, np.inf, None])
def test_bad_sigma(sigma):
    with pytest.raises(ParameterError, match="sigma"):
        local_losses(np.eye(2), np.zeros((2, 2)), sigma)
