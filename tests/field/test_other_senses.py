"""A field over other senses than histograms: it tells where it is, and says so."""

import numpy as np
from small_survey import AREA, path, training

from trexton.cli.train import _verdict
from trexton.evaluation.held_out import Assessment
from trexton.field.field import Field
from trexton.field.linear_motion import Singer
from trexton.field.tracks import TrackFilter
from trexton.localization.observation import Observation


def magnetic(places: np.ndarray, seed: int) -> np.ndarray:
    """Nine correlated features of a smooth vector field, microtesla, with noise."""
    fixed, rng = np.random.default_rng(3), np.random.default_rng(seed)
    waves, phases = fixed.normal(0, 0.9, (40, 2)), fixed.uniform(0, 2 * np.pi, 40)
    vector = 20 * np.cos(places @ waves.T + phases) @ fixed.normal(size=(40, 3)) / np.sqrt(20)
    seen = vector + rng.normal(0, 1.0, vector.shape)
    return np.hstack([seen, seen @ fixed.normal(size=(3, 6)) + rng.normal(0, 0.5, (len(seen), 6))])


def test_a_smooth_vector_field_is_not_lost_in_its_own_survey():
    places, _ = path(500)
    survey = training(500, histograms=magnetic(places, 4))
    tracker = TrackFilter(Singer().fit(survey), Field().fit(survey), AREA)
    errors, lost = [], []
    for histogram in survey.histograms:
        tracker.step(Observation(histogram=lambda seen=histogram: seen))
        estimate = tracker.estimate()
        errors.append(np.hypot(*(estimate.position - places[len(errors)])))
        lost.append(estimate.lost_in(AREA))
    assert np.median(errors[25:]) < 0.1
    assert np.mean(lost[25:]) < 0.05


def test_training_says_why_a_map_would_always_be_lost():
    said = _verdict(Assessment(100, 0.1, 1.0, None, wide_share=1.0))
    assert "LOST in 100%" in said and "too wide for so small an area" in said
    assert "like several places" in _verdict(Assessment(100, 0.1, 1.0, None))
