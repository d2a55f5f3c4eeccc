"""Tracks for other programs: what evo computes from them is what they hold."""

from __future__ import annotations

import numpy as np
import pytest

from trexton.cli.export import write_tum
from trexton.cli.main import main
from trexton.flights.flight import Flight
from trexton.flights.writing import write_flight


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
        file_interface.read_tum_trajectory_file(write_tum(flight(each), tmp_path / name))
        for name, each in (("truth", truth), ("estimate", estimate))
    ]
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data(sync.associate_trajectories(*tracks))
    rmse = float(np.sqrt(np.mean(np.sum((truth - estimate) ** 2, axis=1))))
    assert error.get_statistic(metrics.StatisticsType.rmse) == pytest.approx(rmse, abs=1e-8)


def test_frames_without_a_position_are_left_out(tmp_path):
    position = np.array([[0, 1], [np.nan, np.nan], [2, 3.0]])
    odd = flight(position, height=np.array([1.0, 1.1, 1.2]))
    rows = np.loadtxt(write_tum(odd, tmp_path / "t.tum"))
    half = np.sqrt(0.5)
    expected = [[0, 0, 1, 1, 0, 0, half, half], [0.16, 2, 3, 1.2, 0, 0, half, half]]
    np.testing.assert_allclose(rows, expected, atol=1e-9)


def test_gaps_of_height_and_yaw_are_interpolated(tmp_path):
    """They were 0 among others: evo took them for errors of the track."""
    yaw = np.array([3.1, np.nan, 3.3 - 2 * np.pi])
    attitude = np.column_stack([np.zeros((3, 2)), yaw])
    position = np.array([[0, 1], [1, 2], [2, 3.0]])
    odd = flight(position, height=np.array([1.0, np.nan, 5.0]), attitude=attitude)
    rows = np.loadtxt(write_tum(odd, tmp_path / "t.tum"))
    half = (3.2 + np.pi / 2) / 2
    np.testing.assert_allclose(rows[1, 3:], [3, 0, 0, np.sin(half), np.cos(half)], atol=1e-8)


def test_a_file_of_somebodys_own_is_not_replaced(tmp_path, capsys):
    write_flight(flight(np.array([[0.0, 1], [1, 1], [2, 3]])), tmp_path / "f")
    notes = tmp_path / "notes.txt"
    notes.write_text("mine")
    words = ["export", str(tmp_path / "f"), "tum", "--out", str(notes)]
    assert main(words) == 1 and notes.read_text() == "mine"
    assert "is there already: say --replace" in capsys.readouterr().err
    assert main([*words, "--replace"]) == 0 and len(np.loadtxt(notes)) == 3


def test_a_flight_without_positions_has_no_track(tmp_path, capsys):
    write_flight(flight(np.full((3, 2), np.nan)), tmp_path / "f")
    assert main(["export", str(tmp_path / "f"), "tum", "--out", str(tmp_path / "t.tum")]) == 1
    assert "no frame has a position" in capsys.readouterr().err
    assert not (tmp_path / "t.tum").exists()
