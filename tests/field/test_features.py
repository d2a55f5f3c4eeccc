"""What a field takes of histograms of any kind."""

import numpy as np
import pytest
from small_survey import errors_of, look, path, training

from trexton.field.features import MAX_COMPONENTS, MAX_FEATURES, Features
from trexton.field.field import Field
from trexton.field.linear_motion import Singer
from trexton.field.tracks import TrackFilter


@pytest.fixture
def histograms(rng) -> np.ndarray:
    return look(path(300)[0], rng)


def flown(convert) -> float:
    """Median error of a later flight, of which and of the survey `convert` makes other features."""
    given = training(400)
    places, _ = path(60, start=7.03)
    later = look(places, np.random.default_rng(6))
    survey = training(400, histograms=convert(given.histograms))
    field, motion = Field().fit(survey), Singer().fit(survey)
    return float(
        np.median(errors_of(TrackFilter(motion, field, given.area), places, convert(later)))
    )


@pytest.fixture(scope="module")
def usual() -> float:
    """With the features as they are, for all that differ."""
    return flown(lambda h: h)


def test_frequencies_and_counts_are_their_roots(histograms):
    for scale in (1.0, 255.0, 1e-9):
        given = scale * histograms
        (features,) = Features.candidates(given)
        assert not features.signed
        np.testing.assert_array_equal(features(given), np.sqrt(given))


def test_what_is_the_same_everywhere_or_comes_twice_is_left_out(histograms):
    flat = np.full((len(histograms), 2), 0.3)
    odd = np.hstack([flat, histograms, histograms[:, ::-1]])
    np.testing.assert_array_equal(Features.candidates(odd)[0](odd), np.sqrt(histograms))
    assert Features.candidates(flat)[0](flat).shape[1] == 0


def test_values_below_zero_are_taken_as_they_are(histograms):
    values = 1e4 * (histograms - histograms.mean())
    features, _ = Features.candidates(values)
    assert features.signed
    taken = features(values)
    np.testing.assert_allclose(taken, values / values.std(axis=0))
    np.testing.assert_allclose(features(values[0]), taken[0])


def test_features_that_say_nearly_the_same_may_be_taken_along_their_axes(histograms, rng):
    mixed = histograms[:, :6] @ rng.uniform(0.9, 1.0, (6, 15))
    taken = Features.candidates(mixed)[1](mixed)
    assert taken.shape[1] < 15
    np.testing.assert_allclose(np.cov(taken.T), np.eye(taken.shape[1]), atol=1e-6)


def test_of_very_many_features_the_strongest_axes_are_kept(rng):
    many = rng.poisson(3.0, (500, MAX_FEATURES + 10)).astype(float)
    (only,), fewer = Features.candidates(many), many[:, :MAX_FEATURES]
    assert only(many).shape == (500, MAX_COMPONENTS)
    assert Features.candidates(fewer)[0](fewer).shape == (500, MAX_FEATURES)


@pytest.mark.parametrize(
    "convert",
    [
        lambda h: (h - 0.08) / 0.03,
        lambda h: -h,
        lambda h: np.tile(h, 5),
        lambda h: 1e-9 * h,
        lambda h: 50 + h @ np.random.default_rng(1).uniform(0.9, 1.0, (12, 12)),
        lambda h: np.hstack([h - h.mean(), 1e6 * h[:, :4]]),
    ],
    ids=["centred", "negative", "repeated", "tiny", "nearly the same", "of mixed units"],
)
def test_the_field_flies_as_well_with_other_features(convert, usual):
    assert flown(convert) < 1.25 * usual + 0.01
