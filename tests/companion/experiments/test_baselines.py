"""Baselines: each regression does what its name says, and the verdict follows the records."""

from types import SimpleNamespace

import frontier
import numpy as np
import pytest
from conftest import ROOT
from small_room import histogram_flight

from trexton.base.errors import DataError
from trexton.companion.build import notebook
from trexton.companion.experiments import baselines, senses
from trexton.companion.experiments.baselines import (
    _forest,
    _gaussian_processes,
    _neighbors,
    _smoothed,
)
from trexton.companion.experiments.style import canvas, name_points


@pytest.mark.parametrize(
    "regression, setting",
    [(_neighbors, (3, 3)), (_gaussian_processes, (1.0, 0.03)), (lambda *a: _forest(20, 1, *a), 1)],
)
def test_a_regression_finds_places_by_features(regression, setting, rng):
    places = rng.uniform(0, 1, (400, 2))

    def look(at):
        return np.column_stack([at, np.sin(3 * at), at[:, :1] * at[:, 1:]])

    later = rng.uniform(0.1, 0.9, (50, 2))
    found = regression(look(places), places, setting)(look(later))
    assert np.hypot(*(found - later).T).mean() < 0.06


def test_the_filter_follows_a_constant_velocity_without_lag():
    truth = np.outer(np.arange(200.0), [0.3, -0.1])
    noisy = truth + np.random.default_rng(1).normal(0, 1, truth.shape)
    np.testing.assert_allclose(_smoothed(noisy, 1.0), noisy, atol=1e-12)
    off = (_smoothed(noisy, 0.25) - truth)[50:]
    assert np.abs(off.mean(axis=0)).max() < 0.25
    assert off.std() < 0.6


def test_the_verdict_names_the_better_and_both_directions():
    train, test = histogram_flight("hall", frames=50), histogram_flight("hall", frames=30, noise=2)
    record = baselines.run(train, test, baselines.Parameters(repeats=1, trees=5))
    said = baselines.finding(record)
    values = record.values
    assert ("beats the best" in said) == (
        values["ratio"] <= baselines.WORTH or values["exchanged"]["ratio"] <= baselines.WORTH
    )
    assert "With training and test exchanged" in said
    shown = {label for name, label in baselines.LABELS.items() if name != "field_fixed"}
    assert set(baselines.table(record)["method"]) == shown  # histograms have no light or heading
    (plot,) = baselines.frontier(record).axes
    *points, edge = plot.lines
    assert {text.get_text() for text in plot.texts} == shown
    points = np.concatenate([line.get_xydata() for line in points])
    assert len(points) == len(shown)
    for cost, error in edge.get_xydata()[1:]:
        assert not ((points[:, 0] < cost) & (points[:, 1] <= error)).any()


def test_walks_that_are_not_there_are_said_without_a_path_of_this_machine(monkeypatch):
    def unreachable(name):
        raise DataError("/home/me/ble.csv cannot be fetched (ConnectionError)")

    monkeypatch.setattr(senses, "locate", unreachable)
    flight = histogram_flight("hall", frames=20)
    record = senses.run(flight, flight, senses.Parameters())
    assert record.values["absent"] and not record.timings
    said = senses.finding(record)
    assert "TREXTON_DATA" in said and "/home" not in said and "Connection" not in said


def test_radio_says_by_how_much_the_field_is_worse():
    field = {"mean_cm": {"value": 150, "low": 120, "high": 180}, "held": {"value": 0.86}}
    values = {"absent": False, "best": "hmm", "ratio": 1.5, "field": field}
    said = senses.finding(SimpleNamespace(values=values))
    assert "150 [120, 180] cm, 1.5 times as much as that of the best simple baseline" in said


def test_the_notebook_and_the_claim_name_the_same_data():
    (claim,) = senses.CLAIMS
    assert f"data: {claim['data']}" in (ROOT / "notebooks" / "senses.md").read_text().splitlines()


def test_a_name_hides_no_other_where_there_is_room():
    with canvas(size=(7.2, 3.6)) as (figure, axes):
        plot = axes[0, 0]
        plot.set(xscale="log", yscale="log", xlim=(0.1, 10), ylim=(1, 100))
        name_points(plot, {"one of them": (1.0, 10.0), "the other": (1.2, 10.5)})
        figure.draw_without_rendering()
        one, other = (text.get_window_extent() for text in plot.texts)
    assert not one.overlaps(other)


def test_the_kept_peers_can_be_drawn():
    kept = notebook.reference("frontier")
    assert kept.values["labels"] == frontier.LABELS
    labels = kept.values["labels"]
    assert kept.values["floors"] == 10 and set(kept.timings["step_ms"]) == set(labels)
    (plot,) = baselines.frontier(kept, labels).axes
    assert {text.get_text() for text in plot.texts} == set(labels.values())
