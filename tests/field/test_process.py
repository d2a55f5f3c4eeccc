"""Processes over places: against their definition, left-out blocks against a fit without them.
Blocks cover a flight once, and leave out what is near in time and in space.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import cKDTree

from trexton.field.likelihood import posterior_mean
from trexton.field.process import (
    NOISE,
    Block,
    Process,
    blocks_in_space,
    blocks_in_time,
    matern,
    merge_places,
    nlpd,
    select_length,
)
from trexton.field.tiles import Tiles
from trexton.flights.flight import Flight
from trexton.localization.training import train_map


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


def mean_of(process: Process, places: np.ndarray) -> np.ndarray:
    return posterior_mean(places, process.places, process.weights, process.length)


def test_a_process_follows_the_features_and_doubts_itself_far_away(flown):
    places, features, _ = flown
    process = Process(places, features, 1.0)
    asked = np.array([[2.0, 2.0], [40.0, 40.0]])
    mean, variance = mean_of(process, asked), process.variance(asked)
    truth = waves(np.array([[2.0, 2.0]]))[0] - waves(places).mean(axis=0)
    np.testing.assert_allclose(mean[0], truth, atol=0.15)
    np.testing.assert_allclose(mean[1], 0, atol=1e-6)
    assert variance[0] < 0.1 and variance[1] == pytest.approx(1)


def test_left_out_blocks_are_those_of_a_fit_without_them(flown):
    places, features, time = flown
    process = Process(places, features, 1.0)
    blocks = blocks_in_time(time)
    _, errors, variances = nlpd(process, blocks)
    asked = np.array([[1.0, 1.0], [3.0, 0.5]])
    sets = [asked, asked[::-1]]
    for block, ((mean, variance), other) in process.predict_without(blocks, sets):
        np.testing.assert_array_equal(other[0], mean[::-1])
        kept = np.setdiff1d(np.arange(len(places)), block.left_out)
        without = Process(places[kept], features[kept], 1.0)
        there, doubt = mean_of(without, places[block.rows]), without.variance(places[block.rows])
        np.testing.assert_allclose(errors[block.rows], features[block.rows] - there, atol=1e-8)
        np.testing.assert_allclose(variances[block.rows], doubt + NOISE, atol=1e-8)
        np.testing.assert_allclose(mean, mean_of(without, asked), atol=1e-8)
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


@pytest.mark.parametrize("count", [3, 18, 75])
def test_blocks_cover_a_flight_once_and_leave_something_to_learn_from(count):
    blocks = blocks_in_time(np.arange(count) * 0.08)
    np.testing.assert_array_equal(
        np.concatenate([block.rows for block in blocks]), np.arange(count)
    )
    for block in blocks:
        assert np.isin(block.rows, block.left_out).all()
        assert len(block.left_out) < count


def test_neighbours_in_time_are_left_out_with_a_block():
    time = np.arange(100) * 0.1
    block = blocks_in_time(time)[5]
    assert time[block.left_out].min() == pytest.approx(time[block.rows].min() - 0.5)
    assert time[block.left_out].max() == pytest.approx(time[block.rows].max() + 0.5)


def test_blocks_of_every_third_frame_have_rows_for_each_of_its_parts():
    given = Block(np.array([5, 6, 7, 8, 9]), np.arange(3, 12))
    (block,) = Tiles(np.zeros((2, 2))).blocks([given], 3)
    assert block.rows.tolist() == [4, 5, 6, 7]
    assert block.left_out.tolist() == [2, 3, 4, 5, 6, 7]


def lanes(passes: int, apart: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Six lanes half a metre from each other, flown over and over at half a metre a second."""
    along = np.arange(0, 4, 0.05)
    once = np.concatenate(
        [np.column_stack([along[:: (-1) ** k], np.full(80, 0.5 * k)]) for k in range(6)]
    )
    places = np.concatenate([once + rng.normal(0, apart, once.shape) for _ in range(passes)])
    return places, 0.1 * np.arange(len(places))


def distance_left(blocks: list[Block], places: np.ndarray) -> float:
    """Metres from left-out rows to the nearest frame that was kept, on average."""
    found = [
        cKDTree(np.delete(places, block.left_out, axis=0)).query(places[block.rows])[0]
        for block in blocks
    ]
    return float(np.concatenate(found).mean())


def test_another_pass_over_the_same_lanes_is_left_out_as_far_as_asked_for(rng):
    places, time = lanes(2, 0.01, rng)
    blocks = blocks_in_time(time)
    assert distance_left(blocks, places) < 0.03
    apart = blocks_in_space(blocks, places, time, 0.15)
    assert 0.15 <= distance_left(apart, places) < 0.3
    for block, before in zip(apart, blocks, strict=True):
        np.testing.assert_array_equal(block.rows, before.rows)
        assert np.isin(before.left_out, block.left_out).all()
        assert 2 * len(block.left_out) <= len(places)


def test_blocks_of_a_survey_that_repeats_nothing_stay(rng):
    places, time = lanes(1, 0.0, rng)
    blocks = blocks_in_time(time)
    assert blocks_in_space(blocks, places, time, 0.15) == blocks


def test_no_more_is_left_out_than_is_flown_in_the_margin_of_time(rng):
    places, time = lanes(3, 0.01, rng)
    blocks = blocks_in_space(blocks_in_time(time), places, time, 100.0)
    for block in blocks:
        own = np.arange(block.rows[0] - 5, block.rows[-1] + 6)
        others = np.setdiff1d(block.left_out, own)
        if len(others):
            far = cKDTree(places[block.rows]).query(places[others])[0].max()
            assert far <= 0.25 + 0.05


def test_a_flight_that_hovers_keeps_its_blocks(rng):
    places, time = rng.normal(0, 1e-3, (60, 2)), 0.1 * np.arange(60)
    for block in blocks_in_space(blocks_in_time(time), places, time, 1.0):
        assert len(block.left_out) <= 30


def test_a_survey_flown_twice_claims_what_it_errs():
    """With blocks in time alone two passes claimed half the error of one."""
    waves = np.random.default_rng(3).normal(0, 1.5, (2, 12))

    def claimed(passes: int) -> tuple[float, float]:
        rng = np.random.default_rng(3)
        places, time = lanes(passes, 0.001, rng)
        noise = 0.05 * rng.standard_normal((len(places), 12))
        seen = np.exp(0.5 * np.sin(places @ waves) + noise)
        area, frame = (-0.25, 4.25, -0.25, 2.75), np.arange(len(time))
        survey = Flight("survey", frame, time, places, area, histograms=seen, features="waves")
        field = train_map(survey, method="field", rng=rng).parts["measurement"]
        growth = float(field.correlated_inflation(np.array([[2.0, 1.0]]))[0])
        return field.error_model.correlated_sigma, growth

    once, grown = claimed(1)
    assert grown == 1
    twice, grown = claimed(2)
    assert twice < 0.6 * once < np.sqrt(grown) * twice
