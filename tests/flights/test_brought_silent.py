"""What recordings say that an import read otherwise, and said nothing: heights, lenses, clocks."""

from __future__ import annotations

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from conftest import small_flight
from small_logs import ardupilot_log, subtitles
from small_recording import film
from test_brought_photos import photo, photos
from test_import import picture, write_bag

from trexton.base.errors import FlightError, ParameterError
from trexton.flights.importers import bag, video
from trexton.flights.importers.signals import Settings, read
from trexton.flights.importers.tracks import TrackColumns, read_track
from trexton.flights.importing import import_flight
from trexton.flights.plausibility import warnings
from trexton.flights.tables import read_table
from trexton.vision.calibration import read_calibration

OPENSFM = {"latitude": 47.0, "longitude": 8.0}


@pytest.mark.parametrize("reference", [0.0, 400.0])
def test_altitudes_of_a_reconstruction_are_no_heights(tmp_path, reference):
    source = photos(tmp_path / "p")
    up = 432.0 - reference
    shots = {f"IMG_{i + 7}.jpg": {"rotation": [np.pi, 0, 0], "translation": [-i, 2, up]}
             for i in range(6)}  # fmt: skip
    content = [{"shots": shots, "reference_lla": OPENSFM | {"altitude": reference}}]
    (source / "reconstruction.json").write_text(json.dumps(content))
    chosen = {"positions": "reconstruction.json"}
    flight, said = import_flight(source, tmp_path / "a", settings=chosen)
    assert flight.height is None and any("about 432 m" in line for line in said)
    flight, _ = import_flight(source, tmp_path / "b", settings=chosen | {"ground": 420.0})
    np.testing.assert_allclose(flight.height, 12.0)


def test_what_is_beside_a_log_is_read_or_refused(tmp_path):
    source = photos(tmp_path / "p")
    (tmp_path / "l.bin").write_bytes(ardupilot_log())
    chosen = {"positions": str(tmp_path / "l.bin")}
    with pytest.raises(ParameterError, match="heights, not altitudes: leave --ground out"):
        import_flight(source, tmp_path / "a", settings=chosen | {"ground": 420.0})
    _, said = import_flight(source, tmp_path / "a", settings=chosen | {"offset": 1.714557599e9})
    assert any("whole seconds" in line for line in said)


@pytest.mark.parametrize("model", ["distortion_model: equidistant", "fisheye_model: 1"])
def test_a_fisheye_is_not_undone_as_another_lens(tmp_path, model):
    text = f"image_width: 160\nimage_height: 120\n{model}\n"
    for name, columns, data in (
        ("camera_matrix", 3, "100., 0., 79.5, 0., 100., 59.5, 0., 0., 1."),
        ("distortion_coefficients", 4, "-0.04, 0.008, -0.006, 0.001"),
    ):
        rows = 3 if columns == 3 else 1
        text += f"{name}:\n  rows: {rows}\n  cols: {columns}\n  data: [{data}]\n"
    for kind, known in ((text, None), (text.replace(model, "distortion_model: plumb_bob"), 4)):
        (tmp_path / "c.yaml").write_text(kind)
        _, distortion = read_calibration(tmp_path / "c.yaml")
        assert (distortion is None) if known is None else len(distortion) == known


def test_a_mosaic_that_is_packed_is_in_colour(tmp_path):
    colour = np.full((48, 64, 3), (40, 133, 200), np.uint8)
    mosaic = colour[..., 1].copy()
    mosaic[::2, ::2], mosaic[1::2, 1::2] = 200, 40

    class Item:
        __msgtype__ = "sensor_msgs/msg/CompressedImage"
        format = "bayer_rggb8; png compressed "
        data = np.frombuffer(cv2.imencode(".png", mosaic)[1].tobytes(), np.uint8)

    decoded = bag._decoded("here", (0, 0, Item()))
    np.testing.assert_allclose(decoded[2:-2, 2:-2].mean(axis=(0, 1)), (40, 133, 200), atol=2)
    Item.format = "bayer_rggb8; png compressed bgr8"
    Item.data = np.frombuffer(cv2.imencode(".png", colour)[1].tobytes(), np.uint8)
    np.testing.assert_array_equal(bag._decoded("here", (0, 0, Item())), colour)


def test_headers_of_two_clocks_are_named(tmp_path):
    for behind, said in ((0, 0), (1_500_000_000, 1)):
        write_bag(tmp_path / str(behind), behind=behind)
        known = bag.read(tmp_path / str(behind), bag.Settings()).said
        named = [line for line in known if "headers of images are 1.50 s ahead" in line]
        assert len(named) == said and all("--offset 1.50 joins them" in line for line in named)


def test_rows_that_are_numbered_may_be_left_out(tmp_path):
    rows = [f"{i},{i},2,{np.sin(i):.3f},{np.cos(i):.3f}" for i in range(60) if i % 7 != 3]
    (tmp_path / "f.csv").write_text("frame,x,y,a,b\n" + "\n".join(rows))
    flight, _ = import_flight(
        tmp_path / "f.csv", tmp_path / "out", kind="features", settings={"rate": 10.0}
    )
    np.testing.assert_allclose(flight.time, flight.position[:, 0] / 10)


def test_codes_for_not_heard_and_sources_without_a_name_are_said(tmp_path):
    rows = [f"{100 + i / 4},{'ab'[i % 2]},{-60 - i % 9}" for i in range(40)]
    (tmp_path / "l.csv").write_text("\n".join(["stamp,source,value", *rows, "110.1,a,100"]))
    assert any("values of 100 among" in line for line in read(tmp_path / "l.csv", Settings()).said)
    (tmp_path / "l.csv").write_text("\n".join(["stamp,source,value", *rows, "110.1,,-70"]))
    recording = read(tmp_path / "l.csv", Settings())
    assert recording.names == ("a", "b")
    assert any("source or stamp, left out: 1" in line for line in recording.said)


def test_a_place_of_before_the_first_fix_does_not_turn_the_map(tmp_path):
    text = ardupilot_log(40)
    far = ardupilot_log(3).replace((470000000).to_bytes(4, "little"), b"\0\0\0\x1e", 1)
    assert len(far) == len(ardupilot_log(3)) and far != ardupilot_log(3)
    tracks = []
    for content in (text, far + text[len(far) :]):
        (tmp_path / "l.bin").write_bytes(content)
        tracks.append(read_track(tmp_path / "l.bin", TrackColumns())[0])
    assert len(tracks[1].position) == len(tracks[0].position) - 1
    assert np.hypot(*tracks[1].position[:, :2].T).max() < 100


def test_numbered_parts_of_a_quaternion_begin_with_w(tmp_path):
    half = np.radians(30) / 2
    rows = [f"{i / 10},{i},0,0,{np.cos(half)},{np.sin(half)},0" for i in range(9)]
    (tmp_path / "t.csv").write_text("t,x,y,q[0],q[1],q[2],q[3]\n" + "\n".join(rows))
    names = "q[0],q[1],q[2],q[3]"
    track, said = read_track(tmp_path / "t.csv", TrackColumns(quaternion=names))
    np.testing.assert_allclose(np.degrees(track.attitude), [[0, 0, 30]] * 9, atol=1e-9)
    assert any("taken as w" in line for line in said)


def test_a_yaw_that_is_counted_on_is_in_radians():
    flight = small_flight(200)
    yaw = np.linspace(0, 50, len(flight))
    attitude = np.column_stack([np.zeros((len(flight), 2)), yaw])
    doubts = [each for each in warnings(replace(flight, attitude=attitude)) if "degrees?" in each]
    assert all(each.mend is None for each in doubts)


def reconstruction(folder, **more):
    """Six frames without EXIF, as they are cut out of a video, and their poses."""
    folder.mkdir()
    for i in range(6):
        cv2.imwrite(str(folder / f"IMG_{i + 7}.jpg"), picture(i))
    shots = {f"IMG_{i + 7}.jpg": {"rotation": [np.pi, 0, 0], "translation": [-i, 0, 10]}
             for i in range(6)}  # fmt: skip
    (folder / "reconstruction.json").write_text(json.dumps([{"shots": shots, **more}]))
    return folder


def test_frames_without_a_time_are_not_joined_by_one(tmp_path):
    source = reconstruction(tmp_path / "p")
    (tmp_path / "l.bin").write_bytes(ardupilot_log())
    with pytest.raises(FlightError, match="no time in EXIF"):
        import_flight(source, tmp_path / "a", settings={"positions": str(tmp_path / "l.bin")})
    chosen = {"positions": "reconstruction.json"}
    _, said = import_flight(source, tmp_path / "b", settings=chosen)
    assert any("taken as one a second" in line for line in said)


def test_a_reconstruction_without_gps_lies_nowhere_on_earth(tmp_path):
    nowhere = {"latitude": 0.0, "longitude": 0.0, "altitude": 0.0}
    source = reconstruction(tmp_path / "p", reference_lla=nowhere)
    chosen = {"positions": "reconstruction.json"}
    flight, said = import_flight(source, tmp_path / "a", settings=chosen)
    assert flight.origin is None and any("axes are its own" in line for line in said)
    np.testing.assert_allclose(flight.height, 10)


def test_photographs_that_are_turned_for_showing_are_said(tmp_path):
    from PIL import Image

    source = photos(tmp_path / "p")
    photo(file := source / "IMG_9.jpg", 2, 47 + 2e-5)
    with Image.open(file) as image:
        exif = image.getexif()
        exif[0x0112] = 3
        image.save(file, "JPEG", exif=exif)
    _, said = import_flight(source, tmp_path / "a")
    assert any("EXIF turns 1 of 6 photographs" in line for line in said)


def test_one_image_without_a_stamp_or_of_another_size_costs_that_image_alone(tmp_path):
    write_bag(tmp_path / "bag", unstamped=[1], small=[0])
    flight, said = import_flight(tmp_path / "bag", tmp_path / "out")
    np.testing.assert_allclose(flight.position, [[i, 2] for i in (2, 3, 4)])
    assert any("no stamp: 1 images, 0 positions" in line for line in said)
    assert any("another size than most, left out: 1" in line for line in said)


def test_an_offset_of_clocks_is_advised_where_it_helps_and_not_where_it_is_given(tmp_path):
    write_bag(tmp_path / "bag", behind=90 * 10**9)
    with pytest.raises(FlightError, match="--offset 90.00 joins them"):
        import_flight(tmp_path / "bag", tmp_path / "a")
    flight, said = import_flight(tmp_path / "bag", tmp_path / "b", settings={"offset": 90.0})
    assert len(flight) == 5 and not any("--offset" in line for line in said)


def test_a_small_survey_flown_high_is_asked_about_and_not_scaled():
    flight, around = small_flight(200), (0.0, 17.0, 0.0, 1.0)
    position = np.column_stack([np.linspace(0, 17, 200), np.linspace(0, 1, 200)])
    flight = replace(flight, position=position, area=around)
    for high, mended in ((90.0, False), (270.0, True), (900.0, True)):
        doubts = list(warnings(replace(flight, height=np.full(len(flight), high))))
        (doubt,) = (each for each in doubts if "heights in" in each)
        assert (doubt.mend is not None) == mended


def test_tables_of_metashape_are_read_and_other_languages_refused(tmp_path):
    (tmp_path / "m.csv").write_text(
        '# CoordinateSystem: GEOGCS["WGS 84",AUTHORITY["EPSG","7030"],AUTHORITY["EPSG","6326"]]\n'
        "#Label,X/Longitude,Y/Latitude\nIMG_7.jpg,8.0,47.0\n"
    )
    assert read_table(tmp_path / "m.csv").header == ["Label", "X/Longitude", "Y/Latitude"]
    (tmp_path / "m.csv").write_text('<?xml version="1.0"?>\n<document>\n</document>\n')
    with pytest.raises(FlightError, match="XML or JSON"):
        read_table(tmp_path / "m.csv")


def test_what_is_no_log_is_refused_before_its_reader_tells_of_every_byte(tmp_path, capfd):
    (tmp_path / "images.bin").write_bytes(bytes(3000))
    with pytest.raises(FlightError, match="no log of ArduPilot"):
        read_track(tmp_path / "images.bin", TrackColumns())
    assert capfd.readouterr() == ("", "")


def test_subtitles_of_a_video_whose_first_frame_comes_later(tmp_path, monkeypatch):
    """Its stamps were counted from the first frame, those of the subtitles were not."""
    path, own = film(tmp_path / "v.avi", map(picture, range(20))), video._stamped
    (tmp_path / "v.srt").write_text(subtitles(40))
    later = lambda file: ((0.5 + stamp, frame) for stamp, frame in own(file))  # noqa: E731
    places = []
    for stamped in (own, later):
        monkeypatch.setattr(video, "_stamped", stamped)
        flight, _ = import_flight(path, tmp_path / f"{len(places)}")
        places.append(flight.position[:, 1])
    np.testing.assert_allclose(places[1][:8] - places[0][0], 1.112 * np.arange(10, 18), atol=0.05)
