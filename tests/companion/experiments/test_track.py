"""Runs of the localizer over frames: each as if stepped by hand, and what is read off them."""

import numpy as np
import pytest
from small_room import histogram_flight

from trexton.base.streams import stream
from trexton.companion.experiments.declaration import MapParameters
from trexton.companion.experiments.evaluation import map_of
from trexton.companion.experiments.metrics import euclidean
from trexton.companion.experiments.track import fly, tracks
from trexton.localization.localizer import Localizer
from trexton.localization.training import for_method


@pytest.fixture(scope="module")
def flown():
    train = histogram_flight("hall", frames=130, turns=5.0)
    test = histogram_flight("again", frames=60, turns=5.0, noise=5)
    return map_of(train, MapParameters(neighbors=3)), test


@pytest.mark.parametrize("counted", [None, 400])
@pytest.mark.parametrize("method", ["paper", "field"])
def test_a_run_is_the_localizer_stepped_by_hand(flown, method, counted):
    texton_map, test = for_method(flown[0], method), flown[1]
    run = fly(Localizer(texton_map, rng=stream(1, "run")), test.histograms, counted=counted)
    localizer = Localizer(texton_map, rng=stream(1, "run"))
    said = [
        localizer.advance(localizer.observation(histogram, samples=counted))
        for histogram in test.histograms
    ]
    np.testing.assert_array_equal(run.position, [each.position for each in said])
    np.testing.assert_array_equal(run.spread, [each.spread for each in said])
    np.testing.assert_array_equal(run.lost, [each.lost for each in said])
    assert run.step_s.shape == (len(test),)
    off = run.position - test.position
    np.testing.assert_array_equal(run.errors(test.position), np.hypot(*off.T))
    squared = [each @ np.linalg.solve(c, each) for each, c in zip(off, run.covariance, strict=True)]
    assert (run.held(test.position) == (np.array(squared) < 4.605)).mean() > 0.98


def test_each_run_draws_from_a_stream_of_its_own(flown):
    texton_map, test = flown
    first, second = tracks(texton_map, test.histograms, repeats=2, seed=3, particles=20)
    alone = fly(Localizer(texton_map, particles=20, rng=stream(3, "flight", 1)), test.histograms)
    np.testing.assert_array_equal(second.position, alone.position)
    assert not np.array_equal(first.position, second.position)
    np.testing.assert_array_equal(first.knn, second.knn)  # which draws nothing


def test_distances_of_all_pairs(rng):
    places, others = rng.random((5, 2)), rng.random((3, 2))
    apart = euclidean(places[:, None], others)
    assert apart.shape == (5, 3)
    assert apart[4, 1] == np.hypot(*(places[4] - others[1])) == euclidean(places[4], others[1])
