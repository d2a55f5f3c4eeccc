"""Method field: the tracks that fly over its likelihood, lost and found again, with a velocity."""

from unittest import mock

import numpy as np
import pytest
from scipy.stats import chi2
from small_room import random_walk
from small_survey import AREA, errors_of, look, observed, path

from trexton.base.errors import ParameterError
from trexton.field.recent import RecentFrames
from trexton.field.tracks import TrackFilter, Tracks
from trexton.flights.aiding import Aiding
from trexton.localization.methods import fitting
from trexton.localization.observation import Observation


def test_tracks_follow_the_vehicle(field, motion, later):
    assert np.median(errors_of(TrackFilter(motion, field, AREA), *later)) < 0.1


def test_before_the_first_frame_it_may_be_anywhere(field, motion):
    tracker = TrackFilter(motion, field, AREA)
    tracker.step(None)
    estimate = tracker.estimate()
    assert estimate.lost and estimate.spread[0] > 1


def test_a_first_frame_that_speaks_for_no_place_leaves_it_lost(field, motion, monkeypatch):
    tracker = TrackFilter(motion, field, AREA)
    monkeypatch.setattr(field, "log_posterior", lambda seen: np.zeros(len(field.centers)))
    for _ in range(2):
        tracker.step(observed(np.zeros(12)))
        estimate = tracker.estimate()
        assert estimate.lost and estimate.spread[0] > 1


def test_prediction_alone_widens_the_covariance(field, motion, later):
    tracker = TrackFilter(motion, field, AREA)
    errors_of(tracker, *later)
    before = tracker.estimate().covariance
    for _ in range(10):
        tracker.step(None)
    assert np.trace(tracker.estimate().covariance) > 4 * np.trace(before)


def test_half_a_period_twice_is_a_period(field, motion, later):
    """As a camera of twice the survey's rate advances it; with a velocity that is biased too."""
    hypotheses = TrackFilter(motion, field, AREA).hypotheses
    for place in later[0][:2]:
        hypotheses.give_birth(place, 0.01 * np.eye(2))
    hypotheses.prune(np.zeros(2))
    hypotheses.states[:, 2:4] = 0.3
    hypotheses.switch_bias()
    states, covariances = hypotheses.states, hypotheses.covariances
    hypotheses.predict()
    whole = hypotheses.states, hypotheses.covariances
    hypotheses.states, hypotheses.covariances = states, covariances
    for _ in range(2):
        hypotheses.predict(motion.period_s / 2)
    assert hypotheses.states == pytest.approx(whole[0], abs=1e-9)
    assert hypotheses.covariances == pytest.approx(whole[1], rel=1e-3, abs=1e-9)


@pytest.mark.parametrize("sigma", [None, 0.25])
def test_a_mean_of_estimates_varies_as_independent_s_says(field, motion, sigma, rng):
    """Var(mean of n) = variance times independent_s / (n period), of a Kalman filter that flies the
    model itself; with the velocity of each frame it averages for longer.
    """
    hypotheses, white = TrackFilter(motion, field, AREA).hypotheses, 0.05**2 * np.eye(2)
    (transition, noise), period = hypotheses._period, float(motion.period_s)
    seconds, runs = hypotheses.independent_s(white, sigma), []
    hypotheses.give_birth(np.zeros(2), white)
    hypotheses.prune(np.zeros(1))
    color = np.linalg.cholesky(noise + 1e-15 * np.eye(len(noise)))
    truth = np.zeros(len(noise))
    measured = [(hypotheses.frame, white)]
    if sigma is not None:
        measured.append((hypotheses.velocity, sigma**2 * np.eye(2)))
    for _ in range(12_000):
        truth = transition @ truth + color @ rng.standard_normal(len(truth))
        hypotheses.predict()
        for matrix, variance in measured:
            expected, spread, _, gain = hypotheses.innovation(matrix, variance)
            seen = matrix @ truth + np.sqrt(np.diag(variance)) * rng.standard_normal(2)
            hypotheses.update(seen - expected, gain, spread)
        runs.append((hypotheses.states[0] - truth)[:2])
    errors = np.array(runs[2000:])
    means = errors.reshape(-1, 200, 2).mean(axis=1)  # of 16 s each
    assert np.var(means) / np.var(errors) == pytest.approx(seconds / (200 * period), rel=0.35)
    assert seconds > hypotheses.independent_s(white, None) or sigma is None


def test_a_kidnapped_vehicle_is_found_within_a_second(field, motion, later):
    places, histograms = later
    far = np.hypot(*(places - places[0]).T).argmax()
    tracker = TrackFilter(motion, field, AREA)
    errors_of(tracker, places[:1].repeat(30, axis=0), histograms[:1].repeat(30, axis=0))
    errors = errors_of(tracker, places[far : far + 12], histograms[far : far + 12])
    assert errors[-1] < 0.3


def test_wrong_frames_of_a_kidnapping_are_called_lost_and_calm_ones_are_not(field, motion, later):
    places, histograms = later
    area = AREA[1] - AREA[0]
    wrong, calm = [], []
    for start in range(10, len(places) - 10, 3):
        tracker = TrackFilter(motion, field, AREA)
        far = np.flatnonzero(np.hypot(*(places[:-8] - places[start]).T) > area / 2)
        carried = far[start % len(far)] if len(far) else None
        rows = np.r_[start - 10 : start, carried : carried + 8] if len(far) else []
        for number, row in enumerate(rows):
            tracker.step(observed(histograms[row]))
            estimate = tracker.estimate()
            error = np.hypot(*(estimate.position - places[row]))
            if number >= 10 and error > 1:
                wrong.append(estimate.lost)
            elif 4 < number < 10:
                calm.append(estimate.lost)
    assert len(wrong) > 10 and np.mean(wrong) > 0.9
    assert len(calm) > 100 and np.mean(calm) < 0.01


def test_frames_that_look_like_no_place_of_the_survey_are_called_lost(field, motion, later):
    _, histograms = later
    tracker, lost = TrackFilter(motion, field, AREA), []
    # Another light or a camera without colours: what was one texton is counted as another.
    for histogram in [*np.roll(histograms, 1, axis=1)[:60], *histograms[20:60]]:
        tracker.step(observed(histogram))
        lost.append(tracker.estimate().lost)
    assert all(each is True for each in lost[13:60])  # a second later
    assert not any(lost[85:])  # and found again


def test_covariance_is_inflated_while_frames_are_unlike_the_survey(
    field, motion, later, monkeypatch
):
    """The position is as before; familiar frames claim what they claimed."""
    places, histograms = later

    def claims(mixed: float) -> np.ndarray:
        tracker = TrackFilter(motion, field, AREA)
        for histogram in (1 - mixed) * histograms[:60] + mixed * histograms[::-1][:60]:
            tracker.step(observed(histogram))
        told = tracker.estimate()
        assert not told.lost
        return np.append(told.position, np.trace(told.about_position))

    familiar, unlike = claims(0.0), claims(0.25)
    monkeypatch.setattr("trexton.field.tracks.INFLATION_RESIDUAL", np.inf)
    np.testing.assert_array_equal(familiar, claims(0.0))
    np.testing.assert_array_equal(unlike[:2], claims(0.25)[:2])
    assert unlike[2] > 1.5 * claims(0.25)[2]


def test_a_single_frame_however_novel_is_forgotten(field, motion, later):
    _, histograms = later
    tracker = TrackFilter(motion, field, AREA)
    for histogram in histograms[:30]:
        tracker.step(observed(histogram))
    tracker.step(observed(np.where(np.arange(histograms.shape[1]) == 0, 1e20, 0.0)))
    for histogram in histograms[31:35]:
        tracker.step(observed(histogram))
    assert not tracker.estimate().lost


def test_after_a_reset_the_frame_alone_decides(field, motion, later):
    places, histograms = later
    tracker = TrackFilter(motion, field, AREA)
    errors_of(tracker, *later)
    far = np.hypot(*(places - places[-1]).T).argmax()
    tracker.reset()
    assert errors_of(tracker, places[far : far + 1], histograms[far : far + 1])[0] < 0.5


def test_the_covariance_covers_the_error(field, motion, later):
    places, histograms = later
    tracker, inside = TrackFilter(motion, field, AREA), []
    for place, histogram in zip(places, histograms, strict=True):
        tracker.step(observed(histogram))
        estimate = tracker.estimate()
        offset = place - estimate.position
        inside.append(offset @ np.linalg.solve(estimate.covariance, offset) < 9.21)
    assert np.mean(inside) > 0.9


def test_tracks_refuse_parts_they_cannot_use(field):
    parts = {"filter": Tracks(), "motion": random_walk(np.eye(2)), "measurement": field}
    with pytest.raises(ParameterError, match="'random-walk' does not fit filter 'tracks'"):
        fitting(parts)


def test_a_velocity_that_comes_with_the_frames_makes_both_better(field, motion, later, rng):
    places, histograms = later
    velocity = np.gradient(places, 0.08, axis=0)
    found = {}
    for told in (False, True):
        tracker, errors = TrackFilter(motion, field, AREA), []
        for row, histogram in enumerate(histograms):
            noisy = velocity[row] + 0.05 * rng.standard_normal(2)
            tracker.step(
                Observation(
                    histogram=lambda h=histogram: h, aiding=Aiding(velocity=noisy if told else None)
                )
            )
            estimate = tracker.estimate()
            errors.append(
                [*(estimate.position - places[row]), *(estimate.velocity - velocity[row])]
            )
        found[told] = np.sqrt(np.square(errors[25:]).mean(axis=0))
    assert (found[True][:2] < found[False][:2]).all()
    assert (found[True][2:] < 0.6 * found[False][2:]).all()


def test_a_hypothesis_that_the_measured_velocity_contradicts_loses_weight(field, motion, later):
    tracker = TrackFilter(motion, field, AREA)
    for histogram in later[1][:30]:
        tracker.step(observed(histogram))
    hypotheses = tracker.hypotheses
    here = hypotheses.states[0].copy()
    there = here.copy()
    there[2:4] = -here[2:4]
    hypotheses.states = np.array([here, there])
    hypotheses.covariances = np.repeat(hypotheses.covariances[:1], 2, axis=0)
    hypotheses.weights, hypotheses.outliers = np.array([0.5, 0.5]), np.zeros(2)
    histogram = later[1][30]
    tracker.step(Observation(histogram=lambda: histogram, aiding=Aiding(velocity=here[2:4])))
    assert hypotheses.states[0, 2:4] == pytest.approx(here[2:4], abs=0.3)
    assert hypotheses.weights[0] > 0.6


@pytest.mark.parametrize("told", [True, False])
def test_outliers_mislead_no_filter_with_velocity_aiding(field, motion, later, told):
    places, histograms = later
    velocity = np.gradient(places, 0.08, axis=0)
    away = np.hypot(*(places[40:-8] - places[40]).T).argmax() + 40
    shown = histograms.copy()
    shown[40:48] = histograms[away : away + 8]  # the floor looks there as it does far away
    tracker, errors, lost = TrackFilter(motion, field, AREA), [], []
    for row in range(60):
        aiding = Aiding(velocity=velocity[row] if told else None)
        tracker.step(Observation(histogram=lambda row=row: shown[row], aiding=aiding))
        estimate = tracker.estimate()
        errors.append(np.hypot(*(estimate.position - places[row])))
        lost.append(estimate.lost)
    carried = max(errors[40:48]) > 1
    assert carried != told
    assert any(lost[40:48])  # and it says that something is wrong
    assert max(errors[50:]) < 0.3


def test_with_velocity_aiding_a_kidnapped_vehicle_is_found_within_three_seconds(
    field, motion, later
):
    places, histograms = later
    velocity = np.gradient(places, 0.08, axis=0)
    far = np.hypot(*(places[30:-36] - places[30]).T).argmax() + 30
    tracker = TrackFilter(motion, field, AREA)
    for row in [*range(30), *range(far, far + 36)]:
        told = Aiding(velocity=velocity[row])
        tracker.step(Observation(histogram=lambda row=row: histograms[row], aiding=told))
    assert np.hypot(*(tracker.estimate().position - places[far + 35])) < 0.3


TURNED = np.array([[0.87, 0.5], [-0.5, 0.87]])  # a compass that is off by 30 degrees


@pytest.mark.parametrize(
    ("wrong", "off"),
    [(lambda v: v, 0.0), (lambda v: v @ TURNED, 0.3), (lambda v: v + [0.3, 0.0], 0.3)],
    ids=["right", "turned", "drifting"],
)
def test_a_wrong_velocity_is_noticed_and_costs_little(field, motion, later, wrong, off):
    places, histograms = later
    velocity = wrong(np.gradient(places, 0.08, axis=0))
    alone = errors_of(TrackFilter(motion, field, AREA), places, histograms)
    tracker, errors, claimed, found = TrackFilter(motion, field, AREA), [], [], []
    for row, histogram in enumerate(histograms):
        aiding = Aiding(velocity=velocity[row])
        tracker.step(Observation(histogram=lambda h=histogram: h, aiding=aiding))
        estimate = tracker.estimate()
        offset = estimate.position - places[row]
        errors.append(np.hypot(*offset))
        claimed.append(offset @ np.linalg.solve(estimate.covariance, offset) < 9.21)
        found.append(estimate.velocity_bias)
    known = [each for each in found[40:] if each is not None]
    assert np.mean(errors[40:]) < 1.25 * np.mean(alone[40:])
    assert np.mean(claimed[40:]) > 0.9
    if off:
        assert len(known) > 0.8 * len(found[40:])
        assert np.median(np.hypot(*np.transpose(known))) == pytest.approx(off, abs=0.15)
    else:
        assert not known


def test_a_velocity_that_is_right_again_is_believed_again(field, motion, rng):
    places, _ = path(250, start=51.3)
    histograms = look(places, rng)
    velocity = np.gradient(places, 0.08, axis=0)
    velocity[20:70] += [0.4, 0.0]
    tracker, biased = TrackFilter(motion, field, AREA), []
    for row, histogram in enumerate(histograms):
        aiding = Aiding(velocity=velocity[row])
        tracker.step(Observation(histogram=lambda h=histogram: h, aiding=aiding))
        biased.append(tracker.estimate().velocity_bias is not None)
    assert not any(biased[:20]) and all(biased[50:70]) and not any(biased[-60:])


@pytest.mark.parametrize("glitch", [1e9, -20.0, np.inf, np.nan])
def test_a_velocity_that_no_vehicle_has_moves_nothing(field, motion, later, glitch):
    places, histograms = later
    velocity = np.gradient(places, 0.08, axis=0)
    velocity[40] = glitch
    tracker, errors, found = TrackFilter(motion, field, AREA), [], []
    for row, histogram in enumerate(histograms):
        aiding = Aiding(velocity=velocity[row])
        tracker.step(Observation(histogram=lambda h=histogram: h, aiding=aiding))
        estimate = tracker.estimate()
        errors.append(np.hypot(*(estimate.position - places[row])))
        found.append(estimate.velocity_bias is not None)
    assert max(errors[10:]) < 0.3
    assert np.flatnonzero(found).tolist() == [40]


def test_options_out_of_range_are_refused():
    with pytest.raises(ParameterError, match="tracks"):
        Tracks(tracks=0)
    with pytest.raises(ParameterError, match="velocity_sigma"):
        Tracks(velocity_sigma=0.0)


def true_to_the_model(motion, field, seed, sigma=0.15, frames=25):
    """NEES of a vehicle that moves and is seen as the filter takes it; None where it left the
    area.
    """
    rng, errors = np.random.default_rng(seed), field.error_model
    stays = np.exp(-float(motion.period_s) / errors.time_constant_s)
    state = np.zeros((1, 6))
    state[0, :2] = 2.0, 1.5
    state[0, 2:] = 0.5 * np.sqrt(motion.prior_variance[2:]) * rng.standard_normal(4)
    correlated = errors.correlated_sigma * rng.standard_normal(2)
    tracker = TrackFilter(motion, field, AREA)
    for _ in range(frames):
        state = motion.sample(state, rng)
        kick = errors.correlated_sigma * rng.standard_normal(2)
        correlated = stays * correlated + np.sqrt(1 - stays**2) * kick
        seen = state[0, :2] + correlated + np.hypot(errors.white_sigma, sigma) * rng.normal(size=2)
        likelihood = -np.square(field.centers - seen).sum(axis=1) / (2 * sigma**2)
        with mock.patch.object(field, "log_posterior", lambda _, known=likelihood: known):
            tracker.step(observed(np.ones(12) / 12))
    estimate, place = tracker.estimate(), state[0, :2]
    offset = place - estimate.position
    inside = 0 < place[0] < AREA[1] and 0 < place[1] < AREA[3]
    return offset @ np.linalg.solve(estimate.covariance, offset) if inside else None


def test_nees_is_in_its_band_where_the_model_is_true(field, motion, monkeypatch):
    """Each flight is one draw of a chi-squared of two degrees of freedom."""
    motion = motion.with_learned(acceleration=motion.acceleration / motion.agility)
    monkeypatch.setattr(field, "normalized_residual", lambda *_: 0.5)  # as any frame of the survey
    monkeypatch.setattr(field, "correlated_inflation", lambda _: 1.0)
    drawn = [true_to_the_model(motion, field, seed) for seed in range(120)]
    nees = np.array([each for each in drawn if each is not None])
    low, high = chi2.ppf((0.0005, 0.9995), 2 * len(nees)) / len(nees)
    assert len(nees) > 100 and low < nees.mean() < high
    assert not low < nees.mean() * 1.33**2 < high and not low < nees.mean() / 1.33**2 < high


def test_recent_frames_together_tell_a_path_from_one_that_each_frame_takes_for_it(field):
    recent, path = RecentFrames(field), np.column_stack([np.linspace(1, 2, 30), np.ones(30)])
    for row, place in enumerate(path):
        recent.move(place - path[max(row - 1, 0)])
        other = [0.5 + 0.1 * (row % 3), 2.5]  # fits a little better, but does not move like it
        likely = [-np.square(field.centers - each).sum(axis=1) / 0.02 for each in (place, other)]
        recent.add(np.logaddexp(likely[0], likely[1] + 0.5), 0.08)
    near, far = recent.near(np.array([path[-1], [0.6, 2.5]]), 0.4)
    assert near > 0.9 > 0.1 > far
