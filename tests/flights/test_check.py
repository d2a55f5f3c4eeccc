"""What a person gets wrong in a flight folder is read as meant, or named with what to do."""

from __future__ import annotations

import shutil
from dataclasses import replace

import cv2
import numpy as np
import pytest
from conftest import small_flight

from trexton.base.errors import FlightError
from trexton.flights.check import check_flight, repair_flight
from trexton.flights.folder import read_flight
from trexton.flights.importing import import_flight
from trexton.flights.writing import write_flight


def walk(frames: int = 600):
    """A flight of 3 m x 2 m at about 1 m/s, off the origin so that x and y cannot be mistaken."""
    rng = np.random.default_rng(2)
    place = np.cumsum(rng.normal(0, 0.08, (frames, 2)), axis=0)
    place = (place - place.min(axis=0)) / np.ptp(place, axis=0) * (3, 2) + (10, 1)
    return replace(small_flight(frames), position=place, area=(9.9, 13.1, 0.9, 3.1))


FAR = np.where(np.arange(600)[:, None] % 100 == 7, 1000.0, 0.0)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda f: {"position": f.position[:, ::-1]}, "inside when x and y are exchanged"),
        (lambda f: {"position": f.position * 1000}, "inside when read as millimetres: write "
                                                    "metres"),
        (lambda f: {"position": f.position * 1000, "area": (0, 2e4, 0, 2e4)}, "in millimetres?"),
        (lambda f: {"position": f.position + (0, 2)}, "positions lie outside area_m"),
        # A thousandth of anything lies in an area that holds the origin.
        (lambda f: {"position": f.position - (8, -2), "area": (0, 6, 0, 2)}, "or widen area_m"),
        (lambda f: {"position": np.full((600, 2), 10.0)}, "600 positions span 0 m x 0 m"),
        (lambda f: {"position": f.position / 1000, "area": (0, 1, 0, 1)}, "another unit than "
                                                                          "metres"),
        (lambda f: {"position": f.position + FAR, "area": (0, 2e3, 0, 2e3)}, "6 positions lie "
                                                                             "where none"),
        (lambda f: {"time": f.time * 1000}, "stamps in milliseconds? write seconds"),
        (lambda f: {"time": f.time * 1e9}, "stamps in nanoseconds? write seconds"),
        (lambda f: {"time": f.time * 1e-4}, "stamps in days? write seconds"),
        (lambda f: {"split": {"train": (1, 400), "test": (301, 600)}}, "share 100 frames"),
        (lambda f: {"height": np.full(600, -1.2)}, "does z point down? write metres above"),
        (lambda f: {"height": np.full(600, 1200.0)}, "heights in millimetres? write metres"),
        (lambda f: {"height": np.full(600, 120.0)}, "heights in centimetres? write metres"),
        (lambda f: {"height": np.zeros(600)}, "all 600 heights are 0: write metres above"),
        (lambda f: {"attitude": np.tile([1.0, 2.0, 85.0], (600, 1))}, "degrees? write radians"),
        (lambda f: {"histograms": np.full((600, 4), 0.25)}, "all histograms are the same"),
    ],
)  # fmt: skip
def test_what_looks_wrong_is_one_warning_with_what_to_do(change, words, tmp_path):
    flight = walk()
    assert check_flight(write_flight(flight, tmp_path / "sound")).warnings == []
    report = check_flight(write_flight(replace(flight, **change(flight)), tmp_path / "odd"))
    assert report.usable and len([line for line in report.warnings if words in line]) == 1


@pytest.mark.parametrize(
    ("scale", "shift", "share"),
    [(0.1, 0, None), (0.1, 100, "0%"), (1e-4, 0, "0%"), (100.0, 0, "100%")],
)
def test_a_floor_that_lies_elsewhere_is_doubted(scale, shift, share, tmp_path):
    cv2.imwrite(str(tmp_path / "floor.png"), np.zeros((50, 50, 3), np.uint8))
    place = np.array([[scale, 0, 9 + shift], [0, -scale, 49.5 * scale], [0, 0, 1]])
    flight = replace(walk(), floor_file=tmp_path / "floor.png", floor_from_pixel=place)
    warnings = check_flight(write_flight(flight, tmp_path / "flight")).warnings
    assert len(warnings) == (share is not None)
    assert share is None or f" {share} of the positions lie on it" in warnings[0]


@pytest.mark.parametrize(
    ("row", "text", "fault"),
    [
        (5, "area_m = [0, 1e-7, 0, 1]", "no place to fly in"),
        (5, "area_m = [0, 1e300, 0, 1]", "no place to fly in"),
        (None, "[[1, 0, 0], [2, 0, 0], [0, 0, 1]]", "to a line or a point"),
        (None, "[[1, 2, 0], [2, 4, 0], [0, 0, 1]]", "to a line or a point"),
    ],
)
def test_headers_that_lead_nowhere_are_faults(row, text, fault, flight_folder):
    header = flight_folder / "flight.toml"
    lines = header.read_text().splitlines()
    if row is None:
        cv2.imwrite(str(flight_folder / "f.png"), np.zeros((4, 4, 3), np.uint8))
        lines += ["[floor]", 'image = "f.png"', f"world_from_pixel = {text}"]
    else:
        lines[row - 1] = text
    header.write_text("\n".join(lines))
    assert [fault in line for line in check_flight(flight_folder).faults] == [True]


def test_a_floor_far_from_where_x_and_y_are_zero_is_no_fault(flight_folder):
    cv2.imwrite(str(flight_folder / "f.png"), np.zeros((4, 4, 3), np.uint8))
    place = "[[0.002, 0, 6e5], [0, -0.002, 5.7e6], [0, 0, 1]]"  # as UTM counts
    with open(flight_folder / "flight.toml", "a") as header:
        header.write(f'\n[floor]\nimage = "f.png"\nworld_from_pixel = {place}\n')
    assert not check_flight(flight_folder).faults


@pytest.mark.parametrize(
    ("text", "fault"),
    [
        ("name = 7", "name is 7: expected text"),
        ('notes = "one"', "notes is 'one': expected a list of texts"),
        ("notes = [1]", "notes is [1]: expected a list of texts"),
        ("camera = 3", "camera is 3: expected a table [camera]"),
        ("origin = { latitude_deg = 3 }", "[origin] longitude_deg is missing"),
        ("camera = { width_px = 0, height_px = 2, focal_px = 1.0 }", "expected positive numbers"),
        ("camera = { width_px = 2, height_px = 2, focal_px = -1 }", "expected positive numbers"),
        (
            "camera = { width_px = 2, height_px = 2, focal_px = 1, center_px = [1] }",
            "center_px is [1]: expected [column, row]",
        ),
        ("origin = { latitude_deg = 91, longitude_deg = 0 }", "degrees of latitude, -90 to 90"),
        ('floor = { image = "f.png", world_from_pixel = [[1]] }', "three rows of three numbers"),
    ],
)
def test_every_entry_of_a_header_is_held_to_its_kind(text, fault, flight_folder):
    header = flight_folder / "flight.toml"
    key = text.split()[0]
    lines = [line for line in header.read_text().splitlines() if not line.startswith(f"{key} =")]
    header.write_text("\n".join([text, *lines]))
    assert [fault in line for line in check_flight(flight_folder).faults] == [True]


def test_a_place_beyond_the_earth_and_endless_stamps_are_faults(flight_folder):
    table = flight_folder / "frames.csv"
    text = table.read_text()
    table.write_text(text.replace("\n3,0.16,", "\n3,0.16,1e300,1\n4,0.24,1e300,1\n", 1))
    assert "fields" in check_flight(flight_folder).faults[0]
    lines = text.splitlines()
    table.write_text("\n".join([*lines[:3], "3,0.16,1e300,1", *lines[4:]]))
    assert "row 4: the position is 1e+300 m" in check_flight(flight_folder).faults[0]
    table.write_text("\n".join([*lines[:-1], "40,1e300,1,1"]))
    assert "t_s reaches 1e+300" in check_flight(flight_folder).faults[0]


def test_equal_faults_are_one_line_with_a_count(tmp_path):
    folder = write_flight(walk(), tmp_path / "f")
    lines = (folder / "frames.csv").read_text().splitlines()
    images = [f"{line},{i:04d}.jpg" for i, line in enumerate(lines[1:])]
    (folder / "frames.csv").write_text("\n".join([lines[0] + ",image", *images]))
    report = check_flight(folder)
    text = str(report)
    assert len(report.faults) == text.count("fault    ") == 1
    assert "row 2: image '0000.jpg' is not in" in text
    assert "(and 599 more like it, the last in row 601)" in text
    assert "cannot be used (1 fault" in text


def as_written(folder, change):
    for name in ("frames.csv", "histograms.csv"):
        text = (folder / name).read_bytes().decode()
        (folder / name).write_bytes(change(text))
    return folder


@pytest.mark.parametrize(
    "change",
    [
        lambda text: b"\xef\xbb\xbf" + text.encode(),
        lambda text: text.replace("\n", "\r\n").encode() + b"\r\n\r\n",
        lambda text: text.replace(",", "\t").encode("utf-16"),  # "Unicode text"
        lambda text: b"\xfe\xff" + text.encode("utf-16-be"),
        lambda text: (text + ",,,\n").encode() if text.count(",") < 200 else text.encode(),
        lambda text: text.replace("\n", "\n\n").encode(),
        lambda text: text.replace(",", ";").encode(),
        lambda text: text.replace(",", "\t").encode(),
        lambda text: text.replace(",", ";").replace(".", ",").encode(),
        lambda text: text.replace(",", "\t").replace(".", ",").encode(),
    ],
)
def test_tables_are_read_as_spreadsheets_write_them(change, tmp_path):
    plain = write_flight(small_flight(), tmp_path / "small")
    other = as_written(shutil.copytree(plain, tmp_path / "other"), change)
    report = check_flight(other)
    assert report.usable and not report.warnings
    assert read_flight(other).data_hash == read_flight(plain).data_hash


def test_decimal_commas_between_commas_are_named(flight_folder):
    table = flight_folder / "frames.csv"
    table.write_text("frame,t_s,x_m,y_m\n" + "".join(f"{i},0,{i:02d},1,0,2,0\n" for i in range(40)))
    assert "decimal commas must become points" in check_flight(flight_folder).faults[0]
    table.write_text("frame;t_s;x_m;y_m\n1;0,0;1,5,2;1\n2;0,1;1;1\n")
    assert "x_m is '1,5,2'" in check_flight(flight_folder).faults[0]


def test_one_picture_for_every_frame_is_noticed(image_folder):
    table = image_folder / "frames.csv"
    text = table.read_text()
    for number in range(1, 6):
        text = text.replace(f"{number:04d}.jpg", "0000.jpg")
    table.write_text(text)
    assert any(
        "5 pictures like the one before" in line for line in check_flight(image_folder).warnings
    )


def test_copies_of_one_picture_are_noticed(image_folder):
    pictures = image_folder / "images"
    for number in range(1, 6):
        shutil.copyfile(pictures / "0000.jpg", pictures / f"{number:04d}.jpg")
    warnings = check_flight(image_folder).warnings
    assert any("5 pictures like the one before" in line for line in warnings)


def test_a_camera_that_was_frozen_for_a_while_is_noticed(image_folder):
    assert not any("frozen" in line for line in check_flight(image_folder).warnings)
    pictures = image_folder / "images"
    for number in (3, 4):
        shutil.copyfile(pictures / "0002.jpg", pictures / f"{number:04d}.jpg")
    (warning,) = [line for line in check_flight(image_folder).warnings if "frozen" in line]
    assert (
        "2 pictures like the one before to the byte, or blank (first: frames.csv, row 5)" in warning
    )


def test_blank_pictures_are_named_and_left_out(image_folder, tmp_path):
    """A capped lens, or a frame that a driver filled: of one value, but for compression."""
    for number in (1, 4):
        file = image_folder / "images" / f"{number:04d}.jpg"
        cv2.imwrite(str(file), np.full_like(cv2.imread(str(file)), 10 * number))
    (warning,) = [line for line in check_flight(image_folder).warnings if "blank" in line]
    assert "2 pictures like the one before to the byte, or blank (first" in warning
    repair_flight(image_folder, tmp_path / "mended")
    assert 1 not in (frames := read_flight(tmp_path / "mended").frame) and 4 not in frames
    for file in (image_folder / "images").iterdir():
        cv2.imwrite(str(file), np.zeros_like(cv2.imread(str(file))))
    with pytest.raises(FlightError, match="all are blank"):
        repair_flight(image_folder, tmp_path / "none")


@pytest.mark.parametrize(("bits", "words"), [(12, "6 pictures of 6 darker than 24"), (16, "")])
def test_pictures_of_twelve_bits_in_sixteen_are_named(bits, words, tmp_path):
    from test_import import picture
    from test_import_odd import table

    rows = [f"{i * 0.1:.1f},{i},{i % 3},{i}.png" for i in range(6)]
    source = table(tmp_path / "t", rows)
    for i in range(6):
        deep = picture(i).astype(np.uint16) * 2 ** (bits - 8)
        cv2.imwrite(str(source.parent / f"{i}.png"), deep)
    import_flight(source, tmp_path / "out")
    report = check_flight(tmp_path / "out")
    assert [line for line in report.warnings if "dark" in line] == [
        line for line in report.warnings if words and words in line
    ]
    assert report.usable and bool(words) == any("12 bits in 16?" in x for x in report.warnings)
