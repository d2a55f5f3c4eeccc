"""Flight folders: what is written reads back to the same bits; every kind of bad input is one named
fault.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from conftest import small_flight

from trexton.base.errors import FlightError, ImageError
from trexton.companion.build.flight_pairs import load_pair, with_splits
from trexton.flights.check import check_flight
from trexton.flights.flight import Flight
from trexton.flights.folder import load_folder, read_flight
from trexton.flights.writing import write_flight
from trexton.simulator.floor import Floor
from trexton.vision.camera import Camera


def replace_line(path, row, text):
    """Put `text` in place of row `row` (the header is row 1), as editors count."""
    lines = path.read_text().splitlines()
    lines[row - 1] = text
    path.write_text("\n".join(lines) + "\n")


def test_what_is_written_reads_back_bit_for_bit(tmp_path, rng):
    count = 9
    flight = Flight(
        name='a "quoted" näme',
        frame=np.arange(5, 5 + count),
        time=np.cumsum(rng.random(count) + 0.01),
        position=rng.normal(size=(count, 2)) * 1e3,
        area=(-1.5, 2.25, 0.1, 0.3),
        height=rng.random(count),
        attitude=rng.normal(size=(count, 3)),
        histograms=rng.dirichlet(np.ones(7), count),
        camera=Camera(64, 48, 51.5),
        split={"train": (5, 9), "odd name": (10, 13)},
        source="here",
        licence="none",
        notes=("one", 'two \\ "x"'),
    )
    again = read_flight(write_flight(flight, tmp_path / "f"))
    for key in ("frame", "time", "position", "height", "attitude", "histograms"):
        np.testing.assert_array_equal(getattr(again, key), getattr(flight, key))
    assert (again.name, again.area, again.split, again.notes) == (
        flight.name,
        flight.area,
        flight.split,
        flight.notes,
    )
    assert again.camera.principal_point == flight.camera.principal_point
    assert again.data_hash == flight.data_hash


def test_images_and_floor_travel_with_the_flight(image_folder, tmp_path):
    flight = read_flight(image_folder)
    assert flight.has_images and flight.image(0).shape == (24, 32, 3)
    copy = read_flight(write_flight(flight, tmp_path / "copy"))
    assert copy.data_hash == flight.data_hash
    np.testing.assert_array_equal(copy.image(3), flight.image(3))


def test_the_hash_sees_one_changed_byte_of_one_image(image_folder):
    before = read_flight(image_folder).data_hash
    picture = image_folder / "images" / "0003.jpg"
    picture.write_bytes(picture.read_bytes() + b"\0")
    assert read_flight(image_folder).data_hash != before


def test_the_hash_sees_where_on_earth_a_flight_lies():
    flights = [replace(small_flight(), origin=origin) for origin in (None, (52, 4), (52, 5))]
    assert len({flight.data_hash for flight in flights}) == 3
    assert flights[0].data_hash == small_flight().data_hash


def test_parts_follow_frame_numbers_with_both_ends():
    flight = small_flight(40)
    assert flight.part("train").frame.tolist() == list(range(1, 21))
    assert flight.part("test").frame.tolist() == list(range(21, 41))
    with pytest.raises(FlightError, match="no split 'dawn' .known: train, test."):
        flight.part("dawn")
    assert flight.part_or_all("dawn") is flight
    assert flight.part_or_all("test").frame.tolist() == list(range(21, 41))


@pytest.mark.parametrize(
    ("file", "row", "text", "fault"),
    [
        ("frames.csv", 1, "frame,t_s,x_m,colour", "unknown column 'colour'"),
        ("frames.csv", 1, "frame,t_s,x_m,x_m", "column 'x_m' appears twice"),
        ("frames.csv", 4, "3,0.16,1.0", "row 4: 3 fields where 4 are named"),
        ("frames.csv", 4, "3,0.16,one,1.0", "row 4: x_m is 'one': expected a number"),
        ("frames.csv", 4, "3,0.16,inf,1.0", "row 4: x_m is 'inf': expected a finite number"),
        ("frames.csv", 4, "3,,1.0,1.0", "row 4: t_s is empty: expected a finite number"),
        ("frames.csv", 4, "2.5,0.16,1.0,1.0", "row 4: frame is 2.5: expected a whole number"),
        ("frames.csv", 4, "3,0.08,1.0,1.0", "row 4: duplicated stamp 0.08"),
        ("frames.csv", 4, "3,0.01,1.0,1.0", "row 4: unsorted stamp 0.01"),
        ("frames.csv", 4, "2,0.16,1.0,1.0", "row 4: duplicated frame number 2"),
        ("histograms.csv", 4, "3,0.5,0.3,0.1,0.08", "row 4: the histogram sums to 0.98"),
        (
            "histograms.csv",
            4,
            "3,0.5,0.7,-0.1,-0.1",
            "row 4: the histogram sums to 1 (smallest entry -0.1)",
        ),
        (
            "histograms.csv",
            4,
            "7,0.25,0.25,0.25,0.25",
            "row 4: its frames differ from those of frames.csv",
        ),
        ("histograms.csv", 1, "row,t0,t1,t2,t3", "unknown columns row,t0,t1,t2"),
        ("flight.toml", 1, "format = 2", "format 2 is newer than 1"),
        ("flight.toml", 1, "colour = 2", "unknown key 'colour'"),
        ("flight.toml", 1, "camera = 3", "camera is 3: expected a table"),
        ("flight.toml", 2, "name = 3", "name is 3: expected text"),
        ("flight.toml", 5, "area_m = [1, 0, 0, 1]", "expected [x_min, x_max, y_min, y_max]"),
        ("flight.toml", 5, 'area_m = ["a", 0, 0, 1]', "expected [x_min, x_max, y_min, y_max]"),
        (
            "flight.toml",
            8,
            '"train" = [100, 200]',
            "split 'train' is 100 to 200, but the frames are 1 to 40",
        ),
        ("flight.toml", 8, '"train" = "all"', "expected [first frame, last frame]"),
        ("flight.toml", 1, "= 2", "not valid TOML"),
    ],
)
def test_each_fault_is_named_with_file_and_row(flight_folder, file, row, text, fault):
    replace_line(flight_folder / file, row, text)
    with pytest.raises(FlightError) as caught:
        read_flight(flight_folder)
    assert str(flight_folder / file) in str(caught.value) and fault in str(caught.value)
    report = check_flight(flight_folder)
    assert not report.usable and any(fault in line for line in report.faults)


def test_rows_that_sum_to_1_0002_are_accepted(flight_folder):
    replace_line(flight_folder / "histograms.csv", 4, "3,0.5002,0.3,0.1,0.1")
    assert read_flight(flight_folder).histograms[2].sum() == pytest.approx(1.0002)


def test_a_missing_position_is_reported_but_does_not_forbid_the_flight(flight_folder):
    replace_line(flight_folder / "frames.csv", 6, "5,0.32,nan,")
    report = check_flight(flight_folder)
    assert (
        report.usable
        and len(report.warnings) == 1
        and "frames.csv, row 6: the position is missing" in report.warnings[0]
    )
    flight = read_flight(flight_folder)
    assert not flight.has_positions and np.isnan(flight.position[4]).all()
    assert np.flatnonzero(~flight.located).tolist() == [4]
    assert ("positions", "39 of 40") in report.facts


def test_an_empty_or_absent_folder_is_one_clear_fault(tmp_path):
    with pytest.raises(FlightError, match="flight.toml: not found"):
        read_flight(tmp_path)
    with pytest.raises(FlightError, match="no such folder"):
        read_flight(tmp_path / "nowhere")


def test_a_flight_of_neither_images_nor_histograms_is_refused(flight_folder):
    (flight_folder / "histograms.csv").unlink()
    with pytest.raises(FlightError, match="neither images nor histograms.csv"):
        read_flight(flight_folder)


def test_binary_and_empty_tables_are_faults_not_crashes(flight_folder):
    (flight_folder / "frames.csv").write_bytes(b"\xff\xfb\0\0")
    assert "not a text file" in check_flight(flight_folder).faults[0]
    (flight_folder / "frames.csv").write_text("")
    assert "no rows" in check_flight(flight_folder).faults[0]


def test_every_faulty_image_is_found_even_beside_other_faults(image_folder):
    pictures = image_folder / "images"
    whole = (pictures / "0001.jpg").read_bytes()
    (pictures / "0001.jpg").write_bytes(whole[: len(whole) // 2])
    (pictures / "0002.jpg").write_text("no picture")
    cv2.imwrite(str(pictures / "0003.jpg"), np.zeros((10, 10, 3), np.uint8))
    (pictures / "0004.jpg").unlink()
    report = check_flight(image_folder)
    text = "\n".join(report.faults)
    assert len(report.faults) == 4 and not report.usable
    assert "row 3" in text and "cut short" in text
    assert "row 4" in text and "not an image" in text
    assert "row 5" in text and "10x10 where most are 32x24" in text
    assert "row 6: image '0004.jpg' is not in" in text


def test_images_are_held_against_the_camera_where_one_is_given(image_folder):
    with open(image_folder / "flight.toml", "a") as header:
        header.write("\n[camera]\nwidth_px = 640\nheight_px = 480\nfocal_px = 520\n")
    faults = check_flight(image_folder).faults
    assert len(faults) == 6 and "32x24 where [camera] says 640x480" in faults[0]


def test_a_truncated_image_raises_one_clear_error(image_folder):
    file = image_folder / "images" / "0001.jpg"
    file.write_bytes(file.read_bytes()[:200])
    with pytest.raises(ImageError, match="cut short"):
        read_flight(image_folder).image(1)


def test_an_unreadable_floor_is_a_fault(image_folder):
    (image_folder / "floor.png").write_text("no picture")
    with open(image_folder / "flight.toml", "a") as header:
        header.write(
            '\n[floor]\nimage = "floor.png"\nworld_from_pixel = [[1, 0, 0], [0, -1, 0], [0, 0, '
            "1]]\n"
        )
    assert "floor picture cannot be read" in check_flight(image_folder).faults[0]


def placed(folder, picture, data=None):
    """The flight with a picture of its floor: an array, or a file's bytes."""
    name = "floor.png" if data is None else "floor.jpg"
    data = cv2.imencode(".png", picture)[1].tobytes() if data is None else data
    (folder / name).write_bytes(data)
    with open(folder / "flight.toml", "a") as header:
        header.write(f'\n[floor]\nimage = "{name}"\n')
        header.write("world_from_pixel = [[0.01, 0, 0], [0, -0.01, 1], [0, 0, 1]]\n")
    return read_flight(folder).floor


@pytest.mark.parametrize("alpha", [False, True])
def test_a_floor_of_16_bits_is_that_of_8(image_folder, rng, alpha):
    picture = rng.integers(0, 256, (30, 40, 4 if alpha else 3), dtype=np.uint8)
    floor = placed(image_folder, picture.astype(np.uint16) * 257)
    assert np.array_equal(floor.image, picture[..., :3]) and floor.image.dtype == np.uint8
    assert np.array_equal(floor.mask, picture[..., 3] > 0) if alpha else floor.mask is None


def turned_jpeg(picture):
    """A JPEG that says it must be turned a quarter clockwise to be seen as it was taken."""
    coded = cv2.imencode(".jpg", picture)[1].tobytes()
    exif = b"Exif\0\0MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0"
    return coded[:2] + b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif + coded[2:]


def test_a_photograph_of_a_floor_is_turned_as_every_viewer_turns_it(image_folder):
    picture = np.zeros((32, 64, 3), np.uint8)
    picture[:, :32] = 255
    turned = turned_jpeg(picture)
    floors = [placed(image_folder, None, turned)]
    floors.append(Floor.from_file(image_folder / "floor.jpg", 5.0).picture)
    for floor in floors:
        assert floor.image.shape == (64, 32, 3)
        assert floor.image[:28].min() > 200 and floor.image[36:].max() < 50


def test_images_of_one_name_in_two_folders_stay_two(image_folder, tmp_path, rng):
    table = (image_folder / "frames.csv").read_text().splitlines()
    for row, folder in ((1, "left"), (2, "right")):
        (image_folder / "images" / folder).mkdir()
        name = table[row].rsplit(",", 1)[1]
        (image_folder / "images" / name).rename(image_folder / "images" / folder / "a.jpg")
        table[row] = table[row].replace(name, f"{folder}/a.jpg")
    (image_folder / "frames.csv").write_text("\n".join(table))
    flight = read_flight(image_folder)
    again = read_flight(write_flight(flight, tmp_path / "copy"))
    for row in range(len(flight)):
        assert np.array_equal(again.image(row), flight.image(row))


def test_a_heading_alone_is_read(flight_folder):
    table = (flight_folder / "frames.csv").read_text().splitlines()
    lines = [table[0] + ",yaw_rad", *(line + ",0.5" for line in table[1:])]
    (flight_folder / "frames.csv").write_text("\n".join(lines))
    flight = read_flight(flight_folder)
    assert np.isnan(flight.attitude[:, :2]).all() and (flight.attitude[:, 2] == 0.5).all()
    assert flight.aiding(0).yaw == 0.5 and flight.aiding(0).roll is None


def test_nothing_half_written_stays_when_writing_fails(tmp_path, image_folder):
    flight = read_flight(image_folder)
    (image_folder / "images" / "0005.jpg").unlink()
    with pytest.raises(OSError):
        write_flight(flight, tmp_path / "out" / "copy")
    assert list((tmp_path / "out").iterdir()) == []


def test_loading_collects_faults_of_several_files_at_once(flight_folder):
    replace_line(flight_folder / "frames.csv", 4, "3,0.08,1.0,1.0")
    replace_line(flight_folder / "histograms.csv", 9, "8,0.9,0,0,0")
    replace_line(flight_folder / "flight.toml", 5, "area_m = 3")
    faults = load_folder(flight_folder).faults
    assert [
        sum(name in fault for fault in faults)
        for name in ("flight.toml", "frames.csv", "histograms.csv")
    ] == [1, 1, 1]


def test_splits_are_cut_where_three_fifths_of_the_positions_are_known():
    flight = small_flight(40)
    position = flight.position.copy()
    position[::2] = np.nan  # half of the frames have none
    position[:20] = np.nan
    cut = with_splits(replace(flight, position=position, split={}))
    (_, last), (begin, _) = cut.split["train"], cut.split["test"]
    assert (last, begin) == (32, 33)  # the 6th of 10; frames count from 1
    own = {"train": (0, 9), "test": (10, 39)}
    assert with_splits(replace(flight, split=own)).split == own


def test_images_of_two_sizes_are_no_flight(image_folder):
    """Training counted both alike, although textons are of a size in pixels."""
    file = image_folder / "images" / "0004.jpg"
    cv2.imwrite(str(file), cv2.resize(cv2.imread(str(file)), (64, 48)))
    flight = read_flight(image_folder)
    with pytest.raises(FlightError, match="frame 4 is 64x48 where another is 32x24: all images"):
        list(flight.images())


@pytest.mark.parametrize("key", ["position", "time", "histograms", "height"])
def test_a_flight_has_one_of_each_for_every_frame(key):
    flight = small_flight()
    few = np.zeros((3, 2))[:, 0] if key in ("time", "height") else np.zeros((3, 2))
    with pytest.raises(FlightError, match=f"frame numbers and 3 of {key}: give one for each frame"):
        replace(flight, **{key: few})


def test_a_path_along_one_axis_has_an_area_without_a_header(flight_folder):
    header = flight_folder / "flight.toml"
    lines = [line for line in header.read_text().splitlines() if not line.startswith("area_m")]
    header.write_text("\n".join(lines))
    rows = (flight_folder / "frames.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows[1:]]
    straight = [",".join([frame, time, "2.5", *rest]) for frame, time, _, *rest in cells]
    (flight_folder / "frames.csv").write_text("\n".join([rows[0], *straight]))
    x_min, x_max, y_min, y_max = read_flight(flight_folder).area
    y = [float(row[3]) for row in cells]
    assert (x_min, x_max) == pytest.approx((2.49, 2.51)) and (y_min, y_max) == (min(y), max(y))


def test_a_test_of_one_frame_judges_nothing(tmp_path):
    flight = replace(small_flight(), split={"train": (1, 39), "test": (40, 40)})
    path = write_flight(flight, tmp_path / "small")
    with pytest.raises(
        FlightError, match="'small' has 1 frames with a position to test on: a test"
    ):
        load_pair(path, None)


def test_a_copy_of_the_training_flight_is_no_test(tmp_path):
    """Under any name, and cut to a part; the splits of one flight are no copies."""
    flight = replace(small_flight(), split={})
    trained = write_flight(flight, tmp_path / "trained")
    part = replace(flight, name="other").select(np.arange(10, 40))
    for number, test in enumerate((flight, part)):
        copy = write_flight(test, tmp_path / f"copy {number}")
        with pytest.raises(FlightError, match="frames of flight .* are those it would"):
            load_pair(trained, copy)
    again = replace(flight, histograms=np.roll(flight.histograms, 1, axis=1))
    assert load_pair(trained, write_flight(again, tmp_path / "the same way again"))
    assert load_pair(trained, None)[1].located.all()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"position": np.zeros((40, 3))}, r"position of shape \(40, 3\): expected \(N, 2\)"),
        ({"attitude": np.zeros((40, 2))}, r"attitude of shape \(40, 2\): expected \(N, 3\)"),
        ({"histograms": np.zeros(40)}, r"histograms of shape \(40,\): expected \(N, K\)"),
        ({"height": np.zeros((40, 1))}, r"height of shape \(40, 1\): expected \(N,\)"),
        ({"area": (0, 1, 5, 4)}, "the smaller of each first"),
        ({"area": (0, 1, 5)}, "has the area .0, 1, 5.: expected x_min"),
        ({"area": (0, np.nan, 4, 5)}, "has the area"),
        ({"time": np.r_[0:20, 19:39]}, "time 19.0 after 19.0 in row 20: they must increase"),
        ({"time": 0.0 - np.arange(40)}, "time -1.0 after 0.0 in row 1"),
        ({"time": np.r_[0:39, np.nan]}, "time nan after 38.0 in row 39"),
        ({"frame": np.zeros(40, int)}, "frame 0 after 0 in row 1"),
        ({"frame": np.ma.masked_equal(np.arange(40), 7)}, "frame nan after 6.0 in row 7"),
        ({"frame": np.arange(40).astype(str)}, "frame of type <U21: expected numbers$"),
        ({"time": np.arange(40).astype("M8[us]")}, "type datetime64.us.: expected numbers of sec"),
        ({"position": [["here", 1]] * 40}, "position of type .*: expected numbers$"),
        ({"histograms": np.full((40, 4), 100)}, "a histogram that sums to 400: expected relative"),
        ({"frames": np.zeros((40, 24, 32, 3), np.uint8)}, "ndarray as frames: expected .*ImageFil"),
    ],
)
def test_what_a_flight_is_made_of_has_its_shape_and_its_kind(change, words):
    with pytest.raises(FlightError, match=words):
        replace(small_flight(), **change)


def test_a_masked_position_is_unknown_and_an_area_of_whole_numbers_is_that_of_others():
    flight = small_flight()
    hidden = np.ma.masked_greater(flight.position, flight.position[20, 0])
    masked = replace(flight, position=hidden)
    np.testing.assert_array_equal(np.isnan(masked.position), hidden.mask)
    whole = replace(flight, area=np.array([0, 4, 0, 3]))
    assert whole.data_hash == replace(flight, area=(0.0, 4.0, 0.0, 3.0)).data_hash
