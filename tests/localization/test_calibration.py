"""Calibration and integrity: scales on synthetic truth, held-out replay, claims that hold."""

from dataclasses import replace

import numpy as np
import pytest
from small_room import histogram_flight, observations

from trexton.base.errors import MapError, ParameterError
from trexton.field.integrity import Elsewhere
from trexton.localization.calibration import Evidence, Replay
from trexton.localization.cross_validation import leave_neighbors_out
from trexton.localization.estimate import Estimate, Measurement
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.map_files import load_map, save_map
from trexton.localization.scale import ErrorScale, independent_after
from trexton.localization.training import for_method, train_map, training_set, with_choices
from trexton.localization.training_set import EXCLUDED_SECONDS


@pytest.fixture(scope="module")
def plain() -> TextonMap:
    flight = histogram_flight("hall", frames=160, turns=6.0)
    return train_map(flight, rng=np.random.default_rng(1))


@pytest.fixture(scope="module")
def guarded() -> TextonMap:
    flight = histogram_flight("hall", frames=160, turns=6.0)
    return train_map(flight, method="guarded", rng=np.random.default_rng(1))


def drawn(rng, count):
    """Features, errors and claims whose truth is known: deviation exp(0.3 + 0.5 f)."""
    features = rng.normal(size=(count, 2))
    deviation = np.exp(0.3 + 0.5 * features[:, 0])
    shape = np.array([[2.0, 0.0], [0.0, 0.5]])  # determinant one
    errors = rng.standard_normal((count, 2)) @ np.sqrt(shape) * deviation[:, None]
    return features, errors, np.broadcast_to(3 * shape, (count, 2, 2)), deviation


def test_a_scale_finds_what_the_errors_were_drawn_from(rng):
    features, errors, claimed, deviation = drawn(rng, 4000)
    scale = ErrorScale.fit(features, errors, claimed)
    assert scale.blend == 1.0
    features, errors, claimed, deviation = drawn(rng, 4000)
    np.testing.assert_allclose(scale.deviation(features), deviation, rtol=0.25)
    covariance = scale.covariance(features, claimed)
    squared = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariance), errors)
    assert np.mean(squared < 4.605) == pytest.approx(0.9, abs=0.02)
    assert squared.mean() == pytest.approx(2, rel=0.08)
    again = ErrorScale.from_array(scale.to_array())
    np.testing.assert_array_equal(again.covariance(features, claimed), covariance)
    with pytest.raises(ValueError, match="error scale"):
        ErrorScale.from_array(np.ones(4))


def test_large_outliers_do_not_rule_a_scale(rng):
    features, errors, claimed, deviation = drawn(rng, 4000)
    errors[::50] *= 100
    found = ErrorScale.fit(features, errors, claimed).deviation(features)
    assert np.median(found / deviation) == pytest.approx(1, abs=0.2)


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.8])
def test_errors_are_independent_after_as_long_as_they_last(rng, memory):
    white = rng.standard_normal((6000, 2))
    for row in range(1, len(white)):
        white[row] = memory * white[row - 1] + np.sqrt(1 - memory**2) * white[row]
    expected = (1 + memory) / (1 - memory)
    assert independent_after(white, np.zeros(6000)) == pytest.approx(expected, rel=0.2)
    apart = np.arange(6000) // 10  # no frame follows another for long: there is less to see
    assert independent_after(white, apart) <= expected * 1.2


def test_the_training_flight_flies_as_if_each_frame_were_new(plain):
    flown = list(leave_neighbors_out(plain, training_set(plain, rng=np.random.default_rng(2)), 50))
    rows = np.array([each.row for each in flown])
    settled = round(2.0 / plain.period_s)
    count = len(plain.time) - settled
    np.testing.assert_array_equal(rows[:count], settled + np.arange(count))
    np.testing.assert_array_equal(rows[count:], np.arange(count)[::-1])  # and backwards
    for each in flown:
        apart = np.abs(plain.time[each.neighbors.index] - plain.time[each.row])
        assert apart.min() > EXCLUDED_SECONDS  # neither itself nor what looks like it
        np.testing.assert_array_equal(each.truth, plain.positions[each.row])
    localizer = Localizer(plain, rng=np.random.default_rng(2))
    flattered = [localizer.step(histogram).position for histogram in plain.histograms]
    own = np.hypot(*(np.array(flattered) - plain.positions).T)[settled:].mean()
    assert np.mean([np.hypot(*each.error) for each in flown]) > own


def test_flights_that_cannot_be_judged_are_refused(plain):
    short = replace(plain, histograms=plain.histograms[:10])
    with pytest.raises(MapError, match="longer one"):
        list(leave_neighbors_out(short, training_set(short, rng=np.random.default_rng(2)), 50))
    with pytest.raises(ParameterError, match="needs a RankMixture"):
        with_choices(for_method(plain, "field"), {"calibration": "replay"})


def flights(texton_map, frames=120, **options):
    flight = histogram_flight("again", frames=frames, turns=6.0, noise=5)
    localizer = Localizer(texton_map, rng=np.random.default_rng(3), **options)
    return flight, [localizer.step(each) for each in flight.histograms]


def test_claims_hold_better_than_the_filters_own(plain, guarded):
    def coverage(texton_map):
        flight, estimates = (
            flights(texton_map, calibration="none")
            if texton_map is plain
            else (flights(texton_map))
        )
        errors = np.array([each.position for each in estimates[20:]]) - flight.position[20:]
        about = np.array([each.about_position for each in estimates[20:]])
        squared = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(about), errors)
        return np.mean(squared < 4.605)

    assert abs(coverage(guarded) - 0.9) < abs(coverage(plain) - 0.9) + 0.02
    assert coverage(guarded) > 0.75
    _, estimates = flights(guarded)
    measured = [each.measurement for each in estimates]
    assert all(isinstance(each, Measurement) and each.independent_s > 0 for each in measured)
    assert estimates[0].lost and not estimates[30].lost  # lost until enough was seen


def test_the_position_is_the_same_and_predictions_keep_their_scale(guarded):
    unjudged = with_choices(guarded, {"integrity": "none", "calibration": "none"})
    for raw, judged in zip(flights(unjudged)[1], flights(guarded)[1], strict=True):
        np.testing.assert_array_equal(raw.position, judged.position)
    localizer = Localizer(guarded, rng=np.random.default_rng(3))
    flight = histogram_flight("again", frames=40, turns=6.0, noise=5)
    for histogram in flight.histograms:
        seen = localizer.step(histogram)
    unseen = localizer.step(None)
    assert not unseen.observed and unseen.measurement is None and unseen.lost == seen.lost
    assert np.trace(unseen.covariance) > np.trace(seen.covariance)
    localizer.reset()
    assert localizer.step(flight.histograms[0]).lost


def test_a_trusting_calibration_leaves_the_filter_its_word(plain):
    trusting = with_choices(plain, {"calibration": "replay", "calibration.trusting": True})
    for raw, judged in zip(flights(plain)[1], flights(trusting)[1], strict=True):
        np.testing.assert_array_equal(raw.about_position, judged.covariance)
        assert judged.measurement is not None


def test_a_saved_map_makes_the_same_claims(guarded, tmp_path):
    loaded = load_map(save_map(guarded, tmp_path / "map.npz"))
    for one, other in zip(flights(guarded)[1], flights(loaded)[1], strict=True):
        assert one.covariance.tobytes() == other.covariance.tobytes() and one.lost == other.lost


def test_frames_that_speak_for_another_place_say_lost(guarded):
    """Whatever the filter claims: a wide claim is no excuse."""
    flight = histogram_flight("again", frames=60, turns=3.0, noise=5)
    localizer = Localizer(guarded, rng=np.random.default_rng(3))

    def said(shift, spread):
        judge, answers = guarded.parts["integrity"].open(), []
        for histogram, place in zip(flight.histograms, flight.position, strict=True):
            position = 2 * flight.position.mean(axis=0) - place if shift else place
            here = Estimate(position, spread**2 * np.eye(2), lost=not shift)
            answers.append(judge.judge(here, localizer.observation(histogram)).lost)
        assert judge.judge(here, None).lost == answers[-1]  # nothing new was seen
        judge.reset()
        assert judge.judge(here, None).lost
        return np.array(answers[5:])

    assert said(False, 0.2).mean() < 0.02
    for spread in (0.2, 2.0):
        assert said(True, spread).mean() > 0.8


def test_judges_learn_anew_when_the_method_changes(guarded):
    wider = with_choices(guarded, {"motion.sigma": 0.5})
    assert not np.array_equal(
        wider.parts["calibration"].of_estimate, guarded.parts["calibration"].of_estimate
    )


def test_evidence_is_finite_where_all_neighbours_agree(guarded):
    (observation,) = observations(np.ones((1, 5, 2)))
    evidence = Evidence.of(Estimate(np.ones(2), np.zeros((2, 2))), observation.neighbors)
    assert np.isfinite(evidence.about_estimate).all()
    assert np.isfinite(evidence.about_measurement).all()


def test_what_does_not_fit_is_refused(plain):
    for build in (
        lambda: Replay(samples=0),
        lambda: Elsewhere(doubt=0.0),
        lambda: Elsewhere(cells=1),
        lambda: with_choices(plain, {"calibration.samples": 10}),
    ):
        with pytest.raises(ParameterError, match="expected|choose"):
            build()
    with pytest.raises(ParameterError, match="calibration=replay"):
        with_choices(plain, {"integrity": "elsewhere"})
