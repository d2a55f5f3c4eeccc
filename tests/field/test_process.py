"""Processes over places: against their definition, left-out blocks against a fit without them."""

import numpy as np
import pytest

from trexton.field.process import (
    NOISE,
    Process,
    blocks_in_time,
    matern,
    merge_places,
    select_length,
)


def waves(places: np.ndarray) -> np.ndarray:
    """Three features that change over about a metre."""
    x, y = places.T
    return np.column_stack([np.sin(2 * x), np.cos(1.7 * y), np.sin(x + y)])


@pytest.fixture
def flown(rng):
    places = rng.uniform(0, 4, (120, 2))
    features = waves(places) + 0.05 * rng.standard_normal((120, 3))
    return places, features - features.mean(axis=0), np.arange(120) * 0.1


def test_the_kernel_is_one_at_no_distance_and_falls():
    places = np.array([[0.0, 0.0], [1.0, 0.0], [3.0, 0.0]])
    kernel = matern(places, places, 1.0)
    np.testing.assert_allclose(np.diag(kernel), 1)
    root = np.sqrt(3)
    np.testing.assert_allclose(kernel[0, 1], (1 + root) * np.exp(-root))
    assert kernel[0, 1] > kernel[0, 2]


def test_a_process_follows_the_features_and_doubts_itself_far_away(flown):
    places, features, _ = flown
    process = Process.fit(places, features, 1.0)
    asked = np.array([[2.0, 2.0], [40.0, 40.0]])
    mean, variance = process.mean(asked), process.variance(asked)
    truth = waves(np.array([[2.0, 2.0]]))[0] - waves(places).mean(axis=0)
    np.testing.assert_allclose(mean[0], truth, atol=0.15)
    np.testing.assert_allclose(mean[1], 0, atol=1e-6)
    assert variance[0] < 0.1 and variance[1] == pytest.approx(1)


def test_left_out_blocks_are_those_of_a_fit_without_them(flown):
    places, features, time = flown
    process = Process.fit(places, features, 1.0)
    blocks = blocks_in_time(time)
    errors, variances = process.residuals(blocks)
    asked = np.array([[1.0, 1.0], [3.0, 0.5]])
    sets = [asked, asked[::-1]]
    for block, ((mean, variance), other) in process.predict_without(blocks, sets):
        np.testing.assert_array_equal(other[0], mean[::-1])
        kept = np.setdiff1d(np.arange(len(places)), block.left_out)
        without = Process.fit(places[kept], features[kept], 1.0)
        there, doubt = (each(places[block.rows]) for each in (without.mean, without.variance))
        np.testing.assert_allclose(errors[block.rows], features[block.rows] - there, atol=1e-8)
        np.testing.assert_allclose(variances[block.rows], doubt + NOISE, atol=1e-8)
        np.testing.assert_allclose(mean, without.mean(asked), atol=1e-8)
        np.testing.assert_allclose(variance, without.variance(asked), atol=1e-8)


def test_the_length_of_the_floor_is_selected(rng):
    places = rng.uniform(0, 10, (250, 2))
    time, diagonal = np.arange(250) * 0.1, np.hypot(10, 10)
    blocks = blocks_in_time(time)

    def found(scale: float) -> float:
        features = np.sin(places @ rng.normal(0, scale, (2, 6)))
        centred = features - features.mean(axis=0)
        return select_length(places, centred, blocks, diagonal)[0].length

    assert found(3.0) < found(0.3)


def test_merging_keeps_means_and_counts(rng):
    places = rng.uniform(0, 1, (5000, 2))
    features = waves(places)
    merged, values, counts = merge_places(places, features, 300)
    assert len(merged) <= 300 and counts.sum() == 5000
    np.testing.assert_allclose(counts @ merged / 5000, places.mean(axis=0))
    np.testing.assert_allclose(counts @ values / 5000, features.mean(axis=0))
    np.testing.assert_allclose(values, waves(merged), atol=0.05)


def test_few_places_are_left_as_they_are(flown):
    places, features, _ = flown
    merged, values, counts = merge_places(places, features)
    assert merged is places and values is features and (counts == 1).all()


def test_merging_ends_where_all_places_are_one():
    places = np.ones((50, 2))
    merged, values, counts = merge_places(places, np.arange(50.0)[:, None], 10)
    assert counts.tolist() == [50] and values.tolist() == [[24.5]]
