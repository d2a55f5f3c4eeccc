"""Photographs beside a table of their places."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from test_brought_photos import photo, photos

from trexton.base.errors import FlightError, TrextonError
from trexton.flights.importing import import_flight, preview_import


def table(source: Path, head: str, row: str) -> None:
    """A row for each of six photographs, of its name, its number, and its latitude."""
    rows = [row.format(name=f"IMG_{i + 7}.jpg", i=i, lat=47 + i * 1e-5) for i in range(6)]
    (source / "positions.csv").write_text("\n".join([head, *rows]))


def test_a_table_names_photographs_with_their_folder(tmp_path):
    source = photos(tmp_path / "p")
    rows = [f"images/IMG_{i + 7}.jpg,{47 + i * 1e-5},8" for i in range(6)]
    (source / "positions.csv").write_text("\n".join(["file,lat,lon", *rows]))
    assert len(import_flight(source, tmp_path / "out")[0]) == 6
    (source / "positions.csv").write_text("file,lat,lon\nother.jpg,47,8\n")
    with pytest.raises(FlightError, match=r"names other.jpg, the folder holds IMG_7.jpg"):
        import_flight(source, tmp_path / "again")


def test_places_that_contradict_those_of_exif_are_named(tmp_path):
    source = photos(tmp_path / "p")
    table(source, "file,lat,lon", "{name},8,{lat}")
    with pytest.raises(
        FlightError, match=r"lie 5\d\d\d km from .*, exchanged 0 km: exchange lat and"
    ):
        import_flight(source, tmp_path / "out")
    table(source, "file,lat,lon", "{name},4{lat},8")  # of another place
    with pytest.raises(FlightError, match="expected degrees"):
        import_flight(source, tmp_path / "out")
    for shift, said_so in (("47.1", True), ("47.00001", False)):
        table(source, "file,lat,lon", "{name}," + shift + "{i},8")
        said = import_flight(source, tmp_path / f"out{shift}")[1]
        assert any("km from those in EXIF: are they of these" in line for line in said) == said_so


def test_columns_of_the_pose_that_are_not_read_are_said(tmp_path):
    """Heights and angles of a table were dropped without a word."""
    source = photos(tmp_path / "p")
    table(source, "file,lat,lon,relative_altitude,Yaw [deg],width", "{name},{lat},8,12,90,64")
    said = import_flight(source, tmp_path / "out")[1]
    (line,) = (each for each in said if "not read" in each)
    assert "relative_altitude, Yaw [deg]: not read" in line
    table(source, "file,lat,lon,alt,yaw_accuracy", "{name},{lat},8,412,1")
    assert not any("not read" in each for each in import_flight(source, tmp_path / "other")[1])


@pytest.mark.parametrize(("unit", "altitude"), [("_ft", 1312.336), (" [ft]", 1312.336), ("", 400)])
def test_altitudes_of_a_table_may_be_in_feet(tmp_path, unit, altitude):
    source = photos(tmp_path / "p")
    table(source, f"file,lat,lon,alt{unit}", "{name},{lat},8," + f"{altitude}")
    flight, said = import_flight(source, tmp_path / "out", settings={"ground": "380"})
    np.testing.assert_allclose(flight.height, 20, atol=1e-4)
    assert any("is taken in ft, as its name says" in line for line in said) == bool(unit)


@pytest.mark.parametrize("day", ["", "2024-05-01T"])
def test_times_of_day_go_on_after_midnight(tmp_path, day):
    source = photos(tmp_path / "p")
    table(source, "file,lat,lon,time", "{name},{lat},8," + day + "{{}}")
    text = (source / "positions.csv").read_text()
    clocks = [f"{day}23:59:{54 + 2 * i}" if i < 3 else f"{day}00:00:0{2 * i - 6}" for i in range(6)]
    (source / "positions.csv").write_text(text.replace(day + "{}", "{}").format(*clocks))
    flight, said = import_flight(source, tmp_path / "out")
    after = [line for line in said if "row 5: times of day begin anew: counted on by 24 h" in line]
    if day:  # dates tell themselves
        assert not after and np.ptp(flight.time) > 80_000
    else:
        assert len(after) == 1
        np.testing.assert_allclose(flight.time, [0, 2, 4, 6, 8, 10])
        np.testing.assert_allclose(flight.position[:, 1], 1.112 * np.arange(6), atol=1e-2)


@pytest.mark.parametrize(
    ("head", "row"),
    [
        ("SourceFile,GPSLatitude,GPSLongitude,GPSAltitude", "./{name},{lat},-8,412.5"),
        ("SourceFile,GPSLatitudeRef,GPSLatitude,GPSLongitude,GPSAltitude,DateTimeOriginal",
         './{name},South,"{deg} S","8 deg 0\' 0.00"" W",412.5 m Above Sea Level,'
         "2024:05:01 10:00:0{i}"),
        ("SourceFile,GPSLatitude,GPSLatitudeRef,GPSLongitude,GPSLongitudeRef,GPSAltitude",
         "./{name},{south},S,8,W,412.5"),
        ("lat_accuracy,lon_acc,file,lat,lon,alt", "3,4,{name},{lat},-8,412.5"),
        ("imagename;Latitude;Longitude;Altitude [m]", "{name};{lat};-8;412.5"),
        ("#Label,X/Longitude,Y/Latitude,Z/Altitude", "{name},-8,{lat},412.5"),
        ("timestamp,filename,lat,lng,alt", "2024-05-01T10:00:0{i},{name},{lat},-8,412.5"),
    ],
)  # fmt: skip
def test_tables_of_photographs_as_others_head_them(tmp_path, head, row):
    source, rows = photos(tmp_path / "p"), []
    for i in range(6):
        seconds = i * 0.036
        deg = f'47 deg 0\' {seconds:.3f}""'
        south = 47 + seconds / 3600
        rows.append(row.format(name=f"IMG_{i + 7}.jpg", lat=-south, south=south, deg=deg, i=i))
    (source / "positions.csv").write_text("\n".join([head, *rows]))
    flight, _ = import_flight(source, tmp_path / "out", settings={"ground": "400"})
    assert flight.origin == pytest.approx((-47 - 0.18 / 3600, -8.0))
    np.testing.assert_allclose(np.diff(flight.position[:, 1]), -1.112, atol=2e-3)
    np.testing.assert_allclose(flight.height, 12.5)


def test_a_table_of_places_leaves_what_photographs_know_themselves(tmp_path):
    source = photos(tmp_path / "p", xmp=b'<a drone-dji:RelativeAltitude="12"/>')
    for i in range(6):
        time = f"2024:05:01 10:00:{2 * i:02d}"
        photo(source / f"IMG_{i + 7}.jpg", i, time=time, xmp=b'<a d:RelativeAltitude="12"/>')
        (source / f"._IMG_{i + 7}.jpg").write_bytes(b"\0\5\x16\7" + bytes(4000))  # of macOS
    rows = [f"IMG_{i + 7}.jpg,{47 + i * 1e-5},8" for i in range(6)]
    (source / "positions.csv").write_text("\n".join(["file,lat,lon", *rows]))
    flight, said = import_flight(source, tmp_path / "out")
    np.testing.assert_allclose(flight.time, 2 * np.arange(6))
    np.testing.assert_allclose(flight.height, 12)
    assert not any("left out" in line for line in said)


def test_latitudes_that_are_longitudes_are_named(tmp_path):
    source = photos(tmp_path / "p")
    rows = [f"IMG_{i + 7}.jpg,{151 + i * 1e-5},-33" for i in range(6)]
    (source / "positions.csv").write_text("\n".join(["file,lat,lon", *rows]))
    with pytest.raises(TrextonError, match=r"151.0, -33.0: .* latitude and longitude \(exchanged"):
        preview_import(source)


def test_rows_of_photographs_that_are_not_there_are_said_and_left_out(tmp_path):
    """A table of the whole day, one of whose other rows nobody can read."""
    source = photos(tmp_path / "p")
    table(source, "file,lat,lon,time", "{name},{lat},8,2024-05-01T10:00:0{i}")
    path = source / "positions.csv"
    path.write_text(path.read_text() + "\ngone.jpg,none,8,yesterday\nlost.jpg,47,8,\n")
    flight, said = import_flight(source, tmp_path / "out")
    np.testing.assert_allclose(flight.position[:, 1], 1.112 * np.arange(6), atol=1e-2)
    np.testing.assert_allclose(flight.time, np.arange(6))
    assert f"{path}: rows whose photograph is not there, left out: 2" in said
    path.write_text(path.read_text().replace("2024-05-01T10:00:02", "yesterday"))
    with pytest.raises(FlightError, match=r"positions.csv, row 4: 'yesterday' is no time"):
        import_flight(source, tmp_path / "again")


def test_a_photograph_named_twice_has_no_place(tmp_path):
    source = photos(tmp_path / "p")
    table(source, "file,lat,lon", "{name},{lat},8")
    with open(source / "positions.csv", "a") as stream:
        stream.write("\nIMG_8.jpg,47.5,8\n")
    with pytest.raises(FlightError, match="names IMG_8.jpg 2 times: leave one row"):
        import_flight(source, tmp_path / "out")
