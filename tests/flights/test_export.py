"""Tracks for other programs: what evo computes from them is what the record says."""

from __future__ import annotations

import json

import numpy as np
import pytest

from trexton.base.errors import TrextonError
from trexton.cli.main import main
from trexton.flights import Flight, write_flight
from trexton.flights.exporters import export, load_trajectory
from trexton.flights.geodesy import local_metres


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


def test_a_record_s_stamps_are_those_of_the_flight(record, tmp_path):
    path, _ = record
    content = json.loads(path.read_text())
    before = load_trajectory(path, "estimate").time
    content["series"]["start_s"] = 3.6
    path.write_text(json.dumps(content))
    np.testing.assert_allclose(load_trajectory(path, "estimate").time, before + 3.6)


def test_a_record_s_tracks_lie_at_the_height_and_place_of_its_flight(record, tmp_path):
    path, _ = record
    assert (load_trajectory(path, "estimate").height == 0).all()
    content = json.loads(path.read_text())
    content["series"] |= {"height_m": 1.4, "origin_deg": [52.0, 4.4]}
    content["series"]["field_m"] = content["series"]["estimate_m"]
    content["series"]["paths_m"] = [[[0, 1]], [[1, 2], [3, 4]]]  # of no common length
    path.write_text(json.dumps(content))
    track = load_trajectory(path, "field")
    assert (track.height == 1.4).all() and track.origin == (52.0, 4.4)
    with pytest.raises(TrextonError, match=r"track of nothing \(it has truth, estimate, field\)"):
        load_trajectory(path, "nothing")


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
    assert track.origin is None
    rows = export(track, "csv", tmp_path / "t.csv").read_text().splitlines()
    assert rows == ["t_s,x_m,y_m,z_m,yaw_rad", "0.0,0.0,1.0,1.0,0.0", "0.2,2.0,3.0,1.2,0.0"]
    content = json.loads(export(track, "geojson", tmp_path / "t.json").read_text())
    assert content["features"][0]["geometry"]["coordinates"] == [[0.0, 1.0, 1.0], [2.0, 3.0, 1.2]]


def test_photographs_are_drawn_on_earth_where_they_were_taken(tmp_path):
    """Degrees to metres, into a Flight folder, and back."""
    latitude = np.array([41.2101, 41.2134, 41.2118])
    longitude = np.array([-82.9312, -82.9265, -82.9301])
    place, origin = local_metres(latitude, longitude)
    # A degree of latitude is some 111 km, of longitude less by the cosine.
    np.testing.assert_allclose(place[1] - place[0], (394, 366.5), rtol=3e-3)
    assert (place > -1e-6).all() and origin == (latitude.min(), longitude.min())
    flight = Flight(
        "photos", np.arange(3), np.arange(3) * 1.0, place, (-1, 500, -1, 500),
        height=np.array([80.0, 81, 82]), histograms=np.full((3, 4), 0.25), origin=origin,
    )  # fmt: skip
    track = load_trajectory(write_flight(flight, tmp_path / "photos"))
    (feature,) = json.loads(export(track, "geojson", tmp_path / "t.json").read_text())["features"]
    found = np.array(feature["geometry"]["coordinates"])
    np.testing.assert_allclose(found, np.column_stack([longitude, latitude]), atol=6e-8)
    assert feature["properties"]["unit"] == "deg"
    assert feature["properties"]["height_m"] == [80, 81, 82]
    header = tmp_path / "photos" / "flight.toml"
    header.write_text(header.read_text().replace("latitude_deg = 41", "latitude_deg = 141"))
    with pytest.raises(TrextonError, match=r"\[origin\].*degrees of latitude"):
        load_trajectory(tmp_path / "photos")


def test_what_cannot_be_exported_is_said(record, tmp_path):
    with pytest.raises(TrextonError, match="no record with a track of knn"):
        load_trajectory(record[0], "knn")
    with pytest.raises(TrextonError, match="choose one of tum"):
        export(load_trajectory(record[0]), "kml", tmp_path / "x")


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"time_s": [], "truth_m": []}, "it has none"),
        ({"time_s": [0.0, float("nan")]}, "a stamp or its height is no number"),
        ({"height_m": float("inf")}, "a stamp or its height is no number"),
        ({"origin_deg": [100, 500]}, "its origin is 100, 500 degrees"),
        ({"origin_deg": ["north", "east"]}, "no record with a track"),
    ],
)
def test_a_record_that_is_broken_is_said_and_nothing_written(tmp_path, capsys, changed, message):
    """JSON has no number for what is not finite: other programs would not read it."""
    series = {"time_s": [0.0, 1.0], "truth_m": [[0, 1], [1, 2]]} | changed
    path, out = tmp_path / "record.json", tmp_path / "out.json"
    path.write_text(json.dumps({"flight": "hall", "series": series}))
    assert main(["export", str(path), "geojson", "--out", str(out)]) == 1
    told = capsys.readouterr().err
    assert message in told and "unexpected" not in told and not out.exists()
