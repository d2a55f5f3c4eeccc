"""Recordings as they come from bad days: gaps, odd clocks and shapes, and names given twice."""

from __future__ import annotations

import os
import sqlite3
import tracemalloc
from contextlib import closing

import cv2
import numpy as np
import pytest
from PIL import Image
from small_recording import film
from test_import import euroc, picture, write_bag

from trexton.base.errors import TrextonError
from trexton.flights import importing
from trexton.flights.check import check_flight, repair_flight
from trexton.flights.folder import read_flight
from trexton.flights.frames import ImageFiles
from trexton.flights.importers.images import of_one_size
from trexton.flights.importers.recording import PoseTrack, Recording
from trexton.flights.importers.video import estimate_offset
from trexton.flights.importing import import_flight
from trexton.onboard.sources.video import StreamSource
from trexton.vision.images import read_image


def table(folder, rows, head="t,x,y,image"):
    folder.mkdir(exist_ok=True)
    for i in range(6):
        cv2.imwrite(str(folder / f"{i}.png"), picture(i))
    (folder / "t.csv").write_text("\n".join([head, *rows]))
    return folder / "t.csv"


def photographs(folder, places, times):
    from PIL import Image
    from PIL.TiffImagePlugin import IFDRational

    folder.mkdir()
    for i, (degrees, time) in enumerate(zip(places, times, strict=True)):
        exif = Image.Exif()
        latitude = tuple(degrees) if degrees else (IFDRational(0, 0),) * 3
        exif.get_ifd(0x8825).update({1: "N", 2: latitude, 3: "E", 4: (4.0, 22.0, 0.0)})
        exif.get_ifd(0x8769)[0x9003] = time
        Image.fromarray(picture(i)).save(folder / f"p{i}.jpg", exif=exif)
    return folder


@pytest.mark.parametrize("out", ["MH/mav0", "MH/mav0/cam0/data", "MH"])
def test_a_flight_never_replaces_what_it_is_made_of(tmp_path, out):
    source = euroc(tmp_path / "MH")
    before = sorted(tmp_path.rglob("*"))
    with pytest.raises(TrextonError, match="is read here .* and would be written over"):
        import_flight(source, tmp_path / out, replaced=True)
    assert sorted(tmp_path.rglob("*")) == before


def test_a_flight_never_replaces_its_bag(tmp_path):
    write_bag(tmp_path / "bag")
    with pytest.raises(TrextonError, match="is read here .* and would be written over"):
        import_flight(tmp_path / "bag", tmp_path / "bag", replaced=True)
    assert (tmp_path / "bag" / "metadata.yaml").is_file()


def test_a_flight_beside_its_source_s_files_is_replaced(tmp_path):
    source = euroc(tmp_path / "MH")
    for replaced in (False, True):
        assert len(import_flight(source, source / "flight", replaced=replaced)[0]) == 6


@pytest.mark.parametrize("suffix", ["jpg", "png", "bmp", "tif"])
@pytest.mark.parametrize("size", [(1020, 1024), (1022, 1023), (64, 61), (5, 7)])
def test_pictures_that_are_nearly_square_or_tiny_keep_their_sides(tmp_path, size, suffix):
    file = tmp_path / f"p.{suffix}"
    cv2.imwrite(str(file), picture(0, size))
    assert read_image(file).shape[1::-1] == size


def test_sizes_are_those_of_pictures_as_exif_turns_them(tmp_path):
    shapes = [((64, 48), 1), ((64, 48), 1), ((64, 48), 6), ((48, 64), 8), ((60, 64), 6)]
    for row, (size, turned) in enumerate(shapes):
        exif = Image.Exif()
        exif[0x0112] = turned
        Image.fromarray(picture(row, size)).save(tmp_path / f"{row}.jpg", exif=exif)
    frames = ImageFiles(tuple(sorted(tmp_path.iterdir())))
    assert [frames[row].shape[1::-1] for row in (2, 3, 4)] == [(48, 64), (64, 48), (64, 60)]
    kept = of_one_size(Recording(np.arange(5), frames=frames))
    assert kept.time_ns.tolist() == [0, 1, 3]
    assert kept.said == ["images of another size than 64x48, left out: 2 (first: 2.jpg)"]


def test_rows_without_a_place_are_no_positions(tmp_path):
    rows = [f"{i},{'' if i in (2, 3) else i},1,{i}.png" for i in range(6)]
    flight, said = import_flight(table(tmp_path / "a", rows), tmp_path / "out")
    assert np.isfinite(flight.position[:, 0]).tolist() == [True] * 2 + [False] * 2 + [True] * 2
    assert "4 of 6 frames have a position, largest gap between positions used 0.000 s" in said
    closer = [f"{i / 20},{'' if i == 2 else i},1,{i}.png" for i in range(6)]
    flight, _ = import_flight(table(tmp_path / "b", closer), tmp_path / "closer")
    np.testing.assert_allclose(flight.position[:, 0], np.arange(6))
    none = [f"{i},,1,{i}.png" for i in range(6)]
    with pytest.raises(TrextonError, match="6 rows of positions, no row has a place: give x and y"):
        import_flight(table(tmp_path / "c", none), tmp_path / "none")


def test_rows_that_motion_capture_left_empty_cost_no_other(tmp_path):
    source = euroc(tmp_path / "MH")
    track = source / "mav0" / "vicon0" / "data.csv"
    head, *rows = track.read_text().splitlines()
    lost = [",".join([rows[row].split(",")[0], *["nan"] * 7]) for row in (5, 6)]
    no_turn = ",".join([*rows[20].split(",")[:4], *["nan"] * 4])
    track.write_text("\n".join([head, *rows[:5], *lost, *rows[7:20], no_turn, *rows[21:]]))
    flight, _ = import_flight(source, tmp_path / "out")
    np.testing.assert_allclose(flight.position[:, 0], np.arange(6) * 0.5)
    np.testing.assert_array_equal(np.isnan(flight.attitude[:, 2]), np.arange(6) == 4)


def test_a_video_s_offset_is_found_over_gaps_in_its_positions():
    time = np.arange(0, 12, 0.05)
    speed = 1 + np.sin(time**2 / 10)
    place = np.cumsum(speed) * 0.05
    position = np.column_stack([place, np.zeros((len(time), 2))])
    position[50:56] = np.nan
    track = PoseTrack(np.rint(time * 1e9).astype(np.int64), position)
    offset, correlation = estimate_offset(time[:160], speed[40:200], track)
    assert abs(offset - 2) < 0.1 and correlation > 0.9


@pytest.mark.parametrize(
    ("place", "said"), [("inf", "expected a finite number"), ("5e9", "no such place on Earth")]
)
def test_places_beyond_the_earth_are_noticed_before_images_are_written(
    tmp_path, monkeypatch, place, said
):
    monkeypatch.setattr(importing, "write_images", lambda *_: pytest.fail("images were written"))
    rows = [f"{i},{place if i == 2 else i},1,{i}.png" for i in range(6)]
    with pytest.raises(TrextonError, match=said):
        import_flight(table(tmp_path / "a", rows), tmp_path / "out")


@pytest.mark.parametrize("offset", ["1e30", "-1e300", "nan"])
def test_an_offset_of_centuries_is_refused(offset):
    with pytest.raises(TrextonError, match="expected less than a century"):
        PoseTrack(np.arange(3), np.zeros((3, 3))).shifted(float(offset))


def test_a_scale_that_leaves_no_pixel_is_refused(tmp_path):
    rows = [f"{i},{i},1,{i}.png" for i in range(6)]
    with pytest.raises(TrextonError, match="scale 0.01 leaves nothing of 64x48"):
        import_flight(table(tmp_path / "a", rows), tmp_path / "out", settings={"scale": 0.01})


def test_decimal_commas_are_found_where_the_first_row_has_whole_numbers(tmp_path):
    rows = [f"{i};{str(i / 2).replace('.', ',') if i else 0};1;{i}.png" for i in range(6)]
    flight, _ = import_flight(table(tmp_path / "a", [*rows, ";;;"], "t;x;y;image"), tmp_path / "o")
    np.testing.assert_array_equal(flight.position[:, 0], np.arange(6) / 2)


def test_photographs_whose_receiver_knew_no_place_are_left_out(tmp_path):
    places = [(52.0, 0.0, float(i)) for i in range(5)]
    places[2] = ()  # as a receiver writes it that has no fix
    times = [f"2024:05:01 10:00:0{i}" for i in range(5)]
    flight, said = import_flight(photographs(tmp_path / "p", places, times), tmp_path / "out")
    assert len(flight) == 4 and "photographs without a position, left out: 1" in said


def test_photographs_of_a_camera_without_a_clock_come_by_name(tmp_path):
    places = [(52.0, 0.0, float(i)) for i in range(4)]
    times = ["0000:00:00 00:00:00", "    :  :     :  :  "] * 2
    flight, _ = import_flight(photographs(tmp_path / "p", places, times), tmp_path / "out")
    assert (np.diff(flight.position[:, 1]) > 0).all()
    times[1:] = ["2024:05:01 10:00:00", "2024:05:01 10:00:01", "2024:05:01 10:00:02"]
    mixed, said = import_flight(photographs(tmp_path / "q", places, times), tmp_path / "mixed")
    assert len(mixed) == 3 and "photographs without a time that can be read, left out: 1" in said


def test_a_table_of_photographs_tells_times_of_iso_8601(tmp_path):
    places = [(52.0, 0.0, float(i)) for i in range(4)]
    source = photographs(tmp_path / "p", places, ["2024:05:01 10:00:00"] * 4)
    rows = [f"p{i}.jpg,52.000{i},4,2024-05-01T12:00:0{i}.5+02:00" for i in range(4)]
    (source / "positions.csv").write_text("\n".join(["file,lat,lon,time", *rows]))
    flight, _ = import_flight(source, tmp_path / "out")
    np.testing.assert_array_equal(flight.time, np.arange(4))
    assert flight.notes[0] == "time zero is stamp 1714557600500000000 ns of the source"


def test_a_lens_of_another_model_is_not_undistorted_as_a_pinhole(tmp_path):
    source = euroc(tmp_path / "MH")
    sensor = source / "mav0" / "cam0" / "sensor.yaml"
    text = sensor.read_text()
    sensor.write_text(text + "distortion_model: equidistant\n")
    with pytest.raises(TrextonError, match="no calibration with radial and tangential distortion"):
        import_flight(source, tmp_path / "out", settings={"undistort": str(sensor)})
    assert import_flight(source, tmp_path / "out")[0].camera is not None
    sensor.write_text(text.replace("0.00002]", "0.00002, 1, 1, 1]"))
    with pytest.raises(TrextonError, match="7 distortion coefficients: OpenCV takes 4, 5"):
        import_flight(source, tmp_path / "seven", settings={"undistort": str(sensor)})


def test_a_name_that_is_not_utf_8_is_read(tmp_path):
    named = tmp_path / os.fsdecode(b"caf\xe9")
    euroc(tmp_path / "MH").rename(named)
    assert len(import_flight(named, tmp_path / "out")[0]) == 6


def test_rows_without_an_image_are_positions_between_the_frames(tmp_path):
    """They were looked for in a file named nan."""
    rows = [f"{i},{i * i},0,{f'{i // 2}.png' if i % 2 == 0 else ' '}" for i in range(11)]
    import_flight(table(tmp_path / "some", rows), tmp_path / "flight")
    assert read_flight(tmp_path / "flight").position[:, 0].tolist() == [0, 4, 16, 36, 64, 100]
    with pytest.raises(TrextonError, match="no row of 'image' names an image"):
        import_flight(table(tmp_path / "none", ["1,0,0,", "2,0,1,"]), tmp_path / "other")


@pytest.mark.parametrize("bound", ["MOST_PIXELS", "MOST_BYTES"])
def test_images_of_a_bag_that_are_too_large_are_refused(tmp_path, monkeypatch, bound):
    """A bag of kilobytes may declare pixels of gigabytes."""
    write_bag(tmp_path / "bag")
    monkeypatch.setattr(f"trexton.flights.importers.bag.{bound}", 1000)
    with pytest.raises(TrextonError, match="pixels: expected at most 1,000|bytes: .* to 1,000"):
        import_flight(tmp_path / "bag", tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(("container", "packed"), [("MCAP", "STORAGE"), ("SQLITE3", "MESSAGE")])
def test_a_packed_bag_is_read_but_not_one_that_unpacks_to_gigabytes(
    tmp_path, monkeypatch, container, packed
):
    write_bag(tmp_path / "bag", container, packed)
    assert len(import_flight(tmp_path / "bag", tmp_path / "out")[0]) == 5
    monkeypatch.setattr("trexton.flights.importers.bag.MOST_BYTES", 1)
    monkeypatch.setattr("trexton.flights.importers.bag._check_tables", lambda source: None)
    with pytest.raises(TrextonError, match="would unpack to more than"):
        import_flight(tmp_path / "bag", tmp_path / "other")


def test_what_a_bag_unpacks_to_is_bounded_in_all_and_not_only_piece_by_piece(tmp_path, monkeypatch):
    """A file of kilobytes may hold a thousand pieces, each of the largest size that is read."""
    write_bag(tmp_path / "bag", "SQLITE3", "MESSAGE")
    module = "trexton.flights.importers.bag"
    monkeypatch.setattr(f"{module}.MOST_BYTES", 15_000)  # an image has 9,216
    assert len(import_flight(tmp_path / "bag", tmp_path / "out")[0]) == 5
    monkeypatch.setattr(f"{module}.MOST_TIMES", 0)
    with pytest.raises(TrextonError, match="would unpack to more than"):
        import_flight(tmp_path / "bag", tmp_path / "other")


def test_a_bag_that_is_packed_as_a_file_is_to_be_converted(tmp_path):
    write_bag(tmp_path / "bag", "SQLITE3", "FILE")
    with pytest.raises(TrextonError, match="packed as a whole file: convert it"):
        import_flight(tmp_path / "bag", tmp_path / "out")


@pytest.mark.parametrize(
    "computed",
    [
        "CREATE VIEW v AS WITH RECURSIVE r(i) AS (VALUES(1) UNION SELECT i + 1 FROM r) SELECT 1",
        "CREATE TABLE t (a, b GENERATED ALWAYS AS (zeroblob(900000000)))",
    ],
)
@pytest.mark.parametrize("alone", [True, False])
def test_a_bag_whose_messages_are_computed_is_refused(tmp_path, computed, alone):
    write_bag(tmp_path / "bag")
    (file,) = (tmp_path / "bag").glob("*.db3")
    with closing(sqlite3.connect(file)) as base:
        base.execute(computed)
    source = file.rename(tmp_path / "b.db3") if alone else tmp_path / "bag"
    with pytest.raises(TrextonError, match="is computed: expected stored messages"):
        import_flight(source, tmp_path / "out")


def test_a_message_of_a_database_is_measured_before_it_is_read(tmp_path):
    write_bag(tmp_path / "bag")
    (file,) = (tmp_path / "bag").glob("*.db3")
    with closing(sqlite3.connect(file)) as base:
        base.execute("UPDATE messages SET data = zeroblob(160000000) WHERE id = 2")
        base.commit()
    tracemalloc.start()
    with pytest.raises(TrextonError, match="a message of 160,000,000 bytes"):
        import_flight(tmp_path / "bag", tmp_path / "out")
    assert tracemalloc.get_traced_memory()[1] < 50e6
    tracemalloc.stop()
    file.unlink()


def test_a_video_that_declares_too_much_is_refused_before_a_frame_is_made(tmp_path, monkeypatch):
    path = film(tmp_path / "v.avi", map(picture, range(4)))
    (tmp_path / "p.csv").write_text("t,x,y\n0,1,2\n1,1,2\n")
    monkeypatch.setattr("trexton.vision.images.MOST_PIXELS", 1000)
    with pytest.raises(TrextonError, match="v.avi: declares 64x48 pixels"):
        settings = {"positions": "p.csv", "offset": "0"}
        import_flight(path, tmp_path / "out", kind="video", settings=settings)
    with pytest.raises(TrextonError, match="v.avi: declares 64x48 pixels"):
        StreamSource(str(path)).open()


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.csv", "a,b\n1,2\n", "a.csv has the columns a, b"),
        ("b.csv", "t,x,y,image\n0,1,2,0.png\n1,2\n", "b.csv, row 3: 2 fields where 4 are named"),
        ("c.csv", "", "c.csv: no rows"),
        ("d", None, "d is of no kind that is recognised"),
    ],
)
def test_what_is_no_recording_is_said_by_what_it_holds(tmp_path, name, text, said):
    (tmp_path / name).mkdir() if text is None else (tmp_path / name).write_text(text)
    with pytest.raises(TrextonError, match=said):
        import_flight(tmp_path / name, tmp_path / "out")


def circled(folder, stamps):
    places = [(2 + np.cos(angle), 2 + np.sin(angle)) for angle in np.arange(6) * 0.04]
    rows = [f"{stamps[i]},{x},{y},{i}.png" for i, (x, y) in enumerate(places)]
    return table(folder, rows)


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6)])
def test_a_counter_of_32_bits_that_begins_anew_counts_on(tmp_path, unit, factor):
    stamps = (2**32 + np.arange(-3, 3) * int(0.08 * factor)) % 2**32
    source = circled(tmp_path / "a", stamps)
    flight, said = import_flight(source, tmp_path / "out", settings={"time_unit": unit})
    np.testing.assert_allclose(flight.time, np.arange(6) * 0.08)
    assert not any("order" in line for line in said)


def test_a_clock_that_was_set_back_is_named(tmp_path):
    stamps = [5, 5.1, 5.2, 4.05, 4.15, 4.25]
    _, said = import_flight(circled(tmp_path / "a", stamps), tmp_path / "o")
    assert "goes on at row 5: was a clock set back?" in said[0]
    for repaired in ("o", "repaired"):
        (warning,) = (w for w in check_flight(tmp_path / repaired).warnings if "clock" in w)
        assert warning.endswith(said[0])
        if repaired == "o":
            repair_flight(tmp_path / "o", tmp_path / "repaired")
    rows = [f"{t},{t},0,{t}.png" for t in (3, 4, 5, 0, 1, 2)]  # two files, the later first
    _, said = import_flight(table(tmp_path / "b", rows), tmp_path / "p")
    assert said[0].endswith("1 rows of positions out of order, sorted by their stamps")


@pytest.mark.parametrize("clock", ["{h:02}:{m:02}:{s:06.3f}", "{t:.3f}"])
@pytest.mark.parametrize("kind", ["csv", "features"])
def test_times_of_day_go_on_after_midnight(tmp_path, clock, kind):
    seconds = (86399.8 + 0.1 * np.arange(6)) % 86400
    stamps = [clock.format(h=int(t // 3600), m=int(t // 60 % 60), s=t % 60, t=t) for t in seconds]
    source = circled(tmp_path / "a", stamps)
    settings = {}
    if kind == "features":
        rows = [f"{t},{np.cos(i)},{np.sin(i)},1,2,3" for i, t in enumerate(stamps)]
        source.write_text("\n".join(["t,x,y,a,b,c", *rows]))
        settings = {"time": "t"}
    flight, said = import_flight(source, tmp_path / "o", kind=kind, settings=settings)
    np.testing.assert_allclose(flight.time, 0.1 * np.arange(6), atol=1e-6)
    assert any("row 4: times of day begin anew: counted on by 24 hours" in line for line in said)
    assert not any("clock" in line and "set back" in line for line in (*said, *flight.notes))


def test_stamps_of_a_clock_that_was_set_back_are_counted_on(tmp_path):
    flight = import_flight(circled(tmp_path / "a", np.arange(6) / 10), tmp_path / "o")[0]
    file = tmp_path / "o" / "frames.csv"
    text = file.read_text()
    for late, later in (("0.3", "0.05"), ("0.4", "0.15"), ("0.5", "0.25")):
        text = text.replace(f",{late},", f",{later},")
    file.write_text(text)
    said = repair_flight(tmp_path / "o", tmp_path / "p")
    assert said == ["stamps counted on from frame 3, a clock set back"]
    mended = read_flight(tmp_path / "p")
    np.testing.assert_allclose(mended.time, flight.time, atol=1e-6)
    np.testing.assert_array_equal(mended.position, flight.position)
