"""Nearest histograms against a sorted list of distances."""

from __future__ import annotations

import numpy as np
import pytest

from trexton.base.errors import MapError, ParameterError
from trexton.companion.experiments.sweeps import TreeSearch
from trexton.localization.neighbors import (
    ChiSquare,
    Euclidean,
    Hellinger,
    NearestHistograms,
    neighbors_in_flight,
)


def plain_neighbors(histograms, histogram, k):
    distances = [
        (sum((a - b) ** 2 for a, b in zip(row, histogram, strict=False)), index)
        for index, row in enumerate(histograms.tolist())
    ]
    return [index for _, index in sorted(distances)[:k]]


@pytest.mark.parametrize("search", [NearestHistograms, TreeSearch])
@pytest.mark.parametrize("k", [1, 5, 59, 60])
def test_neighbours_equal_the_sorted_distances(rng, search, k):
    histograms, positions = rng.dirichlet(np.ones(8), 60), rng.normal(size=(60, 2))
    nearest = search(histograms, positions, k)
    for query in rng.dirichlet(np.ones(8), 30):
        found = nearest.query(query)
        assert found.index.tolist() == plain_neighbors(histograms, query, k)
        assert np.allclose(
            found.distance, np.linalg.norm(histograms[found.index] - query, axis=1), rtol=1e-12
        )
        assert (np.diff(found.distance) >= 0).all() and np.array_equal(
            found.position, positions[found.index]
        )


@pytest.mark.parametrize("search", [NearestHistograms, TreeSearch])
def test_ties_go_to_the_lowest_index(rng, search):
    few = rng.integers(0, 3, (400, 4)) / 8  # exact in binary, at most 81 different rows
    nearest = search(few, np.zeros((400, 2)), 7)
    for query in rng.integers(0, 3, (40, 4)) / 8:
        squared = ((few - query) ** 2).sum(axis=1)
        assert (
            nearest.query(query).index.tolist()
            == np.lexsort((np.arange(400), squared))[:7].tolist()
        )


def test_both_searches_give_the_same_bits_on_many_histograms(rng):
    histograms, positions = rng.dirichlet(np.full(20, 0.4), 5000), rng.normal(size=(5000, 2))
    searches = [search(histograms, positions, 5) for search in (NearestHistograms, TreeSearch)]
    for query in np.concatenate([rng.dirichlet(np.full(20, 0.4), 40), histograms[:10]]):
        results = [nearest.query(query) for nearest in searches]
        assert len({(r.index.tobytes(), r.distance.tobytes()) for r in results}) == 1


def test_a_search_of_another_kind_finds_its_candidates_itself(rng):
    nearest = TreeSearch(rng.dirichlet(np.ones(8), 60), rng.normal(size=(60, 2)), 5)
    nearest._tree = None
    with pytest.raises(AttributeError):
        nearest.query(rng.dirichlet(np.ones(8)))


def test_real_histograms(cyberzoo):
    known = np.isfinite(cyberzoo.histograms).all(axis=1)
    histograms, positions = cyberzoo.histograms[known], cyberzoo.position[known]
    brute, tree = (search(histograms, positions, 5) for search in (NearestHistograms, TreeSearch))
    for row in range(0, len(histograms), 25):
        assert brute.query(histograms[row]).index[0] == row
        assert (
            brute.query(histograms[row]).index.tolist()
            == tree.query(histograms[row]).index.tolist()
        )


def test_bad_input_is_one_clear_error(rng):
    histograms, positions = rng.dirichlet(np.ones(4), 10), np.zeros((10, 2))
    with pytest.raises(MapError, match=r"\(10, 4\) and \(9, 2\)"):
        NearestHistograms(histograms, positions[:9])
    with pytest.raises(MapError, match="finite"):
        NearestHistograms(np.full((10, 4), np.nan), positions)
    for k in (0, 11):
        with pytest.raises(ParameterError, match=f"k is {k}: expected 1 to 10"):
            NearestHistograms(histograms, positions, k)
    with pytest.raises(MapError, match="histogram of 4 textons"):
        NearestHistograms(histograms, positions).query(np.ones(5) / 5)
    with pytest.raises(MapError, match="finite histogram"):
        NearestHistograms(histograms, positions).query(np.array([1, np.nan, 0, 0]))
    with pytest.raises(MapError, match="finite histogram"):
        NearestHistograms(histograms, positions).query(np.array([1, np.inf, 0, 0]))


@pytest.mark.parametrize("excluded_s, nearest_allowed", [(0.0, 1), (0.1, 2), (0.25, 3)])
def test_only_the_excluded_seconds_are_excluded(excluded_s, nearest_allowed):
    """The frame before looks most alike; it may be a neighbour unless its time is excluded."""
    phase = np.arange(40) / 40
    histograms, time = np.column_stack([phase, 1 - phase]), np.arange(40) * 0.1
    nearest = NearestHistograms(histograms, np.zeros((40, 2)))
    rows = neighbors_in_flight(nearest, histograms, time, 2, excluded_s)
    steps = np.abs(rows - np.arange(40)[:, None])
    assert steps.min() == nearest_allowed and (steps[5:-5] == nearest_allowed).all()


def test_tree_and_brute_force_learn_the_same_neighbours(rng):
    histograms, time = rng.dirichlet(np.ones(8), 400), np.arange(400) * 0.08
    found = [
        neighbors_in_flight(search(histograms, np.zeros((400, 2)), 5), histograms, time, 5, 0.5)
        for search in (NearestHistograms, TreeSearch)
    ]
    np.testing.assert_array_equal(*found)


def test_hellinger_tells_values_below_zero_apart():
    below, above = np.array([-0.5, -0.125]), np.array([0.5, 0.125])
    features = Hellinger().features
    np.testing.assert_array_equal(features(above), [0.5, 0.25])
    np.testing.assert_array_equal(features(below), [-0.5, -0.25])


def test_chi_square_is_half_the_sum_over_what_either_has():
    queries, rows = np.array([[0.5, 0.0, 0.25]]), np.array([[0.25, 0.0, 0.75], [0.0, 0.0, 0.25]])
    expected = [0.5 * (0.25**2 / 0.75 + 0.5**2 / 1.0), 0.5 * 0.5**2 / 0.5]
    np.testing.assert_allclose(ChiSquare().between(queries, rows), [expected])


@pytest.mark.parametrize("distance", [Euclidean(), Hellinger()])
def test_what_has_features_lies_between_them(distance):
    queries, rows = np.array([[0.5, 0.5], [1.0, 0.0]]), np.array([[0.25, 0.75]])
    apart = distance.features(queries) - distance.features(rows)
    np.testing.assert_allclose(distance.between(queries, rows), np.hypot(*apart.T)[:, None])


@pytest.mark.parametrize("k", [0, -1, 21, 2.5])
def test_a_number_of_neighbours_that_cannot_be_is_refused(k, rng):
    nearest = NearestHistograms(rng.dirichlet(np.ones(5), 20), rng.random((20, 2)))
    with pytest.raises(ParameterError, match="k is"):
        nearest.query(np.full(5, 0.2), k)
