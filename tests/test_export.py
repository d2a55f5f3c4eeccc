"""Tracks for other programs: what evo computes from them is what the record says."""

from __future__ import annotations

import json

import numpy as np
import pytest

from trexton.errors import TrextonError
from trexton.flights import Flight, write_flight
from trexton.flights.exporters import export, load_trajectory


@pytest.fixture
def record(tmp_path):
    rng = np.random.default_rng(3)
    truth = rng.uniform(0, 5, (40, 2))
    estimate = truth + rng.normal(0, 0.3, (40, 2))
    series = {
        "time_s": list(np.arange(40) * 0.08),
        "truth_m": truth.tolist(),
        "estimate_m": estimate.tolist(),
    }
    path = tmp_path / "record.json"
    path.write_text(json.dumps({"flight": "hall", "series": series}))
    return path, float(np.sqrt(np.mean(np.sum((truth - estimate) ** 2, axis=1))))


def test_evo_computes_the_same_error(record, tmp_path):
    from evo.core import metrics, sync
    from evo.tools import file_interface

    path, rmse = record
    for what in ("truth", "estimate"):
        export(load_trajectory(path, what), "tum", tmp_path / f"{what}.tum")
    tracks = [
        file_interface.read_tum_trajectory_file(tmp_path / f"{w}.tum")
        for w in ("truth", "estimate")
    ]
    error = metrics.APE(metrics.PoseRelation.translation_part)
    error.process_data(sync.associate_trajectories(*tracks))
    assert error.get_statistic(metrics.StatisticsType.rmse) == pytest.approx(rmse, abs=1e-8)


def test_a_flight_as_table_and_geojson(tmp_path):
    flight = Flight(
        "f",
        np.arange(3),
        np.arange(3) * 0.1,
        np.array([[0, 1], [np.nan, np.nan], [2, 3.0]]),
        (0, 2, 1, 3),
        height=np.array([1.0, 1.1, 1.2]),
        histograms=np.full((3, 4), 0.25),
    )
    track = load_trajectory(write_flight(flight, tmp_path / "f"))
    rows = export(track, "csv", tmp_path / "t.csv").read_text().splitlines()
    assert rows == ["t_s,x_m,y_m,z_m,yaw_rad", "0.0,0.0,1.0,1.0,0.0", "0.2,2.0,3.0,1.2,0.0"]
    content = json.loads(export(track, "geojson", tmp_path / "t.json").read_text())
    assert content["features"][0]["geometry"]["coordinates"] == [[0.0, 1.0, 1.0], [2.0, 3.0, 1.2]]


def test_what_cannot_be_exported_is_said(record, tmp_path):
    with pytest.raises(TrextonError, match="no record with a track of knn"):
        load_trajectory(record[0], "knn")
    with pytest.raises(TrextonError, match="choose one of tum"):
        export(load_trajectory(record[0]), "kml", tmp_path / "x")
