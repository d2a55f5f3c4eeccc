"""Tracks for other programs: what evo computes from them is what they hold."""

from __future__ import annotations

import numpy as np
import pytest

from trexton.base.errors import TrextonError
from trexton.flights import Flight
from trexton.flights.exporters import export
from trexton.flights.importers.recording import local_metres


def flight(position: np.ndarray, **more) -> Flight:
    count = len(position)
    return Flight(
        "f", np.arange(count), np.arange(count) * 0.08, position, (0, 9, 0, 9),
        histograms=np.full((count, 4), 0.25), **more,
    )  # fmt: skip


def test_evo_computes_the_same_error(tmp_path):
    from evo.core import metrics, sync
    from evo.tools import file_interface

    rng = np.random.default_rng(3)
    truth = rng.uniform(0, 5, (40, 2))
    estimate = truth + rng.normal(0, 0.3, (40, 2))
    tracks = [
        file_interface.read_tum_trajectory_file(export(flight(each), "tum", tmp_path / name))
        for name, each in (("truth", truth), ("estimate", estimate))
    ]
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data(sync.associate_trajectories(*tracks))
    rmse = float(np.sqrt(np.mean(np.sum((truth - estimate) ** 2, axis=1))))
    assert error.get_statistic(metrics.StatisticsType.rmse) == pytest.approx(rmse, abs=1e-8)


def test_frames_without_a_position_are_left_out(tmp_path):
    position = np.array([[0, 1], [np.nan, np.nan], [2, 3.0]])
    attitude = np.array([[0, 0, np.nan], [0, 0, 0], [0, 0, np.pi / 2]])
    odd = flight(position, height=np.array([1.0, 1.1, 1.2]), attitude=attitude)
    rows = np.loadtxt(export(odd, "tum", tmp_path / "t.tum"))
    half = np.sqrt(0.5)
    expected = [[0, 0, 1, 1, 0, 0, half, half], [0.16, 2, 3, 1.2, 0, 0, 1, 0]]
    np.testing.assert_allclose(rows, expected, atol=1e-9)


def test_degrees_become_metres():
    latitude = np.array([41.2101, 41.2134, 41.2118])
    longitude = np.array([-82.9312, -82.9265, -82.9301])
    place, origin = local_metres(latitude, longitude)
    # A degree of latitude is some 111 km, of longitude less by the cosine.
    np.testing.assert_allclose(place[1] - place[0], (394, 366.5), rtol=3e-3)
    assert (place > -1e-6).all() and origin == (latitude.min(), longitude.min())


def test_a_format_that_is_not_known_is_said(tmp_path):
    with pytest.raises(TrextonError, match="choose one of tum"):
        export(flight(np.ones((3, 2))), "kml", tmp_path / "x")
