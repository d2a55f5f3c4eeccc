"""The field's likelihood against its plain definitions."""

import numpy as np
import pytest

from trexton.field.likelihood import (
    CLUTTER_SHARE,
    COUNTED_RESIDUAL,
    DEGREES_OF_FREEDOM,
    Basis,
    Table,
    TileTables,
    better_half,
    bilinear,
    log_prior,
    rbf_kernel,
    tile_bases,
)


@pytest.fixture
def spread(rng):
    """Variances of a signal ``(3,)`` and covariance of its noise ``(3, 3)``."""
    root = rng.normal(size=(3, 3))
    return rng.uniform(0.5, 2, 3), 0.1 * root @ root.T + 0.05 * np.eye(3)


@pytest.mark.parametrize("samples", [None, 100])
def test_in_the_basis_noise_is_white_and_the_signal_diagonal(spread, samples):
    signal, noise = spread
    basis = Basis.of(signal, noise, samples)
    counted = 0 if samples is None else 0.25 / samples
    white = basis.whiten.T @ (noise + counted * np.eye(3)) @ basis.whiten
    np.testing.assert_allclose(white, np.eye(3), atol=1e-9)
    along = basis.whiten.T @ np.diag(signal) @ basis.whiten
    np.testing.assert_allclose(along, np.diag(basis.strength), atol=1e-8)


def test_a_noise_without_extent_is_divided_by_no_zero():
    basis = Basis.of(np.ones(2), np.diag([1.0, 0.0]), None)
    assert np.isfinite(basis.whiten).all() and (basis.strength >= 0).all()


def plain(features, mean, variance, strength):
    """Squared distance and log likelihood at every cell, one after the other."""
    squared, found = [], []
    for m, v in zip(mean, variance, strict=True):
        total = 1 + v * strength
        squared.append(sum((features - m) ** 2 / total))
        half = (DEGREES_OF_FREEDOM + len(features)) / 2
        bent = half * np.log(1 + squared[-1] / DEGREES_OF_FREEDOM)
        found.append(-0.5 * np.log(total).sum() - bent)
    return np.array(squared), np.array(found)


def test_a_table_holds_students_distribution_at_every_cell(rng):
    mean, variance, strength = rng.normal(size=(7, 4)), rng.uniform(0, 1, 7), rng.uniform(1, 9, 4)
    table = Table(mean, variance, Basis(np.eye(4), strength))
    features = rng.normal(size=(5, 4))
    expected = [plain(each, mean, variance, strength) for each in features]
    found = table.log_likelihood(features)
    np.testing.assert_allclose(found, [log for _, log in expected], atol=1e-4)
    np.testing.assert_allclose(table.log_likelihood(features[0]), found[0], atol=1e-6)
    cells = np.array([0, 6, 3, 3, 1])
    squared = [each[cell] / 4 for (each, _), cell in zip(expected, cells, strict=True)]
    np.testing.assert_allclose(table.squared_residual(features, cells), squared, atol=1e-4)


def test_tiles_have_a_distribution_each_and_the_better_half_says_what_is_familiar(rng, spread):
    signal, noise = spread
    bases = [Basis.of(signal * scale, noise, None) for scale in (1, 2, 3, 4)]
    means, variance = [rng.normal(size=(6, 3)) for _ in bases], rng.uniform(0, 1, 6)
    tables, features = TileTables(means, variance, bases), rng.normal(size=(2, 12))
    found = tables.log_likelihoods(features)
    assert found.shape == (4, 2, 6)
    cells, squared = np.array([2, 5]), []
    for tile, (mean, basis) in enumerate(zip(means, bases, strict=True)):
        own = features[:, 3 * tile : 3 * tile + 3] @ basis.whiten
        both = [plain(each, mean @ basis.whiten, variance, basis.strength) for each in own]
        # A mixture with what a tile shows of a place of which nothing is known.
        new = [plain(each, np.zeros((1, 3)), [1.0], basis.strength)[1] for each in own]
        known = [log for _, log in both]
        mixed = np.log(np.exp(known) + CLUTTER_SHARE * np.exp(new))
        np.testing.assert_allclose(found[tile], mixed, atol=1e-3)
        squared.append([each[cell] / 3 for (each, _), cell in zip(both, cells, strict=True)])
    expected = np.sort(squared, axis=0)[:3].mean(axis=0)
    found = better_half(tables.squared_residuals(features, cells))
    np.testing.assert_allclose(found, expected, rtol=1e-3)


@pytest.mark.parametrize("scale", [0.5, 1.0, 1.6])
def test_of_few_samples_the_noise_is_that_of_counting(rng, spread, scale):
    signal, noise = spread
    means, variance = [np.zeros((2, 3))] * 4, np.zeros(2)

    def familiar(samples: int | None) -> float:
        bases = [Basis.of(signal, noise / 100, samples)] * 4
        return TileTables(means, variance, bases).familiar_residual(scale)

    assert familiar(None) == scale  # where every patch is counted
    least = max(scale, COUNTED_RESIDUAL)
    assert scale <= familiar(10**4) <= familiar(400) <= familiar(1) <= least
    assert familiar(1) == pytest.approx(least, rel=0.1)


def test_the_share_of_the_noise_that_counting_adds_is_that_of_whitened_draws(rng):
    noise = np.diag([1e-3, 4e-3])
    basis = Basis.of(np.ones(2), noise, 100)
    counted = 0.05 * rng.standard_normal((20_000, 2)) @ basis.whiten
    assert np.square(counted).mean() == pytest.approx(basis.counted, rel=0.05)


def test_radial_functions_are_a_third_of_the_length_wide():
    kernel = rbf_kernel(np.array([[0.0, 0.0], [3.0, 4.0]]), np.array([[0.0, 0.0], [3.0, 3.0]]), 3.0)
    np.testing.assert_allclose(kernel, np.exp([[0.0, -9.0], [-12.5, -0.5]]), rtol=1e-9)


def test_a_tenth_of_the_prior_expects_nothing():
    np.testing.assert_allclose(np.exp(log_prior(np.array([0.0, 1.0, 3.0]))), [0.1, 0.775, 2.125])
    assert log_prior(np.zeros(3)).tolist() == [0, 0, 0]


def test_the_blocks_of_tiles_lie_on_the_diagonal(rng):
    root, signal = rng.normal(size=(6, 6)), rng.uniform(1, 2, 6)
    noise = root @ root.T
    for tile, basis in enumerate(tile_bases(signal, noise, 3)):
        own = slice(2 * tile, 2 * tile + 2)
        expected = Basis.of(signal[own], noise[own, own], None)
        np.testing.assert_array_equal(basis.whiten, expected.whiten)


def test_a_grid_is_read_between_its_centres_and_constant_beyond(rng):
    area = np.array([1.0, 3.0, -2.0, 4.0])
    x, y = 1 + (np.arange(4) + 0.5) / 2, -2 + (np.arange(5) + 0.5) * 1.2
    grid = 2 * x[:, None] - 3 * y + x[:, None] * y  # bilinear, so between centres it is exact
    places = rng.uniform((x[0], y[0]), (x[-1], y[-1]), (50, 2))
    expected = 2 * places[:, 0] - 3 * places[:, 1] + places.prod(axis=1)
    np.testing.assert_allclose(bilinear(grid, area, places), expected)
    np.testing.assert_allclose(bilinear(grid, area, np.array([[0, 9.0]])), grid[0, -1])
