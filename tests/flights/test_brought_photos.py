"""Photographs that people bring: places, heights, times and angles, by EXIF, XMP or a table."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from test_import import picture

from trexton.base.errors import ImageError, TrextonError
from trexton.flights.check import check_flight
from trexton.flights.importing import import_flight, preview_import
from trexton.vision.images import read_image, read_picture


def photo(path: Path, i: int, latitude=47.0, longitude=8.0, **how) -> None:
    from PIL import Image
    from PIL.TiffImagePlugin import IFDRational

    def parts(value):
        return (IFDRational(int(abs(value) * 3_600_000), 3_600_000), 0.0, 0.0)

    exif = Image.Exif()
    exif.get_ifd(0x8825).update(
        {1: "N" if latitude >= 0 else "S", 2: parts(latitude), 6: how.get("altitude", 400.0),
         3: "E" if longitude >= 0 else "W", 4: parts(longitude), 5: b"\0"}
    )  # fmt: skip
    exif.get_ifd(0x8825).update(how.get("tags", {}))
    details = exif.get_ifd(0x8769)
    details[0x9003] = how.get("time", f"2024:05:01 10:00:{i:02d}")
    if "subsec" in how:
        details[0x9291] = how["subsec"]
    if "zone" in how:
        details[0x9011] = how["zone"]
    xmp = {"xmp": how["xmp"]} if "xmp" in how else {}
    Image.fromarray(picture(i)).save(path, "JPEG", exif=exif, **xmp)


def photos(folder: Path, count=6, **how) -> Path:
    folder.mkdir(exist_ok=True)
    for i in range(count):
        photo(folder / f"IMG_{i + 7}.jpg", i, 47 + i * 1e-5, **how)
    return folder


def test_heights_above_the_sea_are_no_heights(tmp_path):
    flight, said = import_flight(photos(tmp_path / "p"), tmp_path / "a")
    assert flight.height is None and any("--ground" in line for line in said)
    flight, _ = import_flight(tmp_path / "p", tmp_path / "b", settings={"ground": "380"})
    np.testing.assert_allclose(flight.height, 20)


@pytest.mark.parametrize(
    ("tags", "angles"),
    [
        ('drone-dji:RelativeAltitude="+39.80" drone-dji:GimbalPitchDegree="-80" '
         'drone-dji:GimbalYawDegree="90" drone-dji:GimbalRollDegree="0"', (0, 10, -90)),
        ('Camera:AboveGroundAltitude="39.8" Camera:Pitch="10" Camera:Yaw="90" Camera:Roll="2"',
         (2, 10, -90)),
        ('drone-parrot:CameraPitchDegree="-80" drone-parrot:CameraYawDegree="90" '
         'Camera:AboveGroundAltitude="39.8"', (0, 10, -90)),
        ('drone:RelativeAltitude="39.8" drone:GimbalPitchDegree="-90" drone:GimbalYawDegree="0"',
         (0, 0, 0)),
        # Autel's pitch is that of a gimbal, in the names of Pix4D.
        ('Camera:Pitch="-80" Camera:Yaw="90" Camera:Roll="0" drone:RelativeAltitude="39.8"',
         (0, 10, -90)),
        # What no number can be is not known.
        (f'drone-dji:RelativeAltitude="39.8" drone-dji:GimbalPitchDegree="-1e30090.0" '
         f'drone-dji:GimbalYawDegree="{"9" * 400}" Camera:Pitch="0" Camera:Yaw="0"', (0, 0, 0)),
        # Parrot's own documentation writes a fraction.
        ('Camera:AboveGroundAltitude="10433331/262144" Camera:Pitch="0" Camera:Yaw="0"', (0, 0, 0)),
        # Straight down, a roll turns the picture; turned over, the gimbal looks down as well.
        ('drone-dji:RelativeAltitude="3.98e+1" drone-dji:GimbalPitchDegree="-90" '
         'drone-dji:GimbalYawDegree="90" drone-dji:GimbalRollDegree="10"', (0, 0, -100)),
        ('drone-dji:RelativeAltitude="39,8" drone-dji:GimbalPitchDegree="-80" '
         'drone-dji:GimbalYawDegree="90" drone-dji:GimbalRollDegree="180"', (0, -10, 90)),
        ('drone-dji:RelativeAltitude="39.8" drone-dji:FlightPitchDegree="-5" '
         'drone-dji:FlightYawDegree="90" drone-dji:FlightRollDegree="2"', (2, -5, -90)),
    ],
)  # fmt: skip
def test_heights_and_angles_in_xmp(tmp_path, tags, angles):
    spaces = " ".join(f'xmlns:{space}="http://{space}/"' for space in
                      ("drone-dji", "Camera", "drone-parrot", "drone"))  # fmt: skip
    xmp = (
        '<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/'
        f'22-rdf-syntax-ns#"><rdf:Description {spaces} {tags}/></rdf:RDF></x:xmpmeta>'
    )
    flight, _ = import_flight(photos(tmp_path / "p", xmp=xmp.encode()), tmp_path / "out")
    np.testing.assert_allclose(flight.height, 39.8, atol=1e-5)
    np.testing.assert_allclose(np.degrees(flight.attitude[0]), angles, atol=1e-9)


def test_places_of_photographs(tmp_path):
    (tmp_path / "p").mkdir()
    for i in range(6):
        latitude, longitude = (-33.9 + i * 1e-5, -70.6) if i != 2 else (0.0, 0.0)
        photo(tmp_path / "p" / f"{i}.jpg", i, latitude, longitude)
    for path in (tmp_path / "p").iterdir():  # the letters as another type than text
        data = path.read_bytes()
        for tag, letter in ((b"\0\1", b"S"), (b"\0\3", b"W")):
            data = data.replace(tag + b"\0\2\0\0\0\2" + letter, tag + b"\0\7\0\0\0\2" + letter)
        path.write_bytes(data)
    flight, said = import_flight(tmp_path / "p", tmp_path / "out")
    assert len(flight) == 5 and "photographs without a fix, at 0, 0, left out: 1" in said
    np.testing.assert_allclose(flight.origin, (-33.9, -70.6), atol=1e-6)
    assert (np.diff(flight.position[:, 1]) > 0).all()


@pytest.mark.parametrize("tags", [{1: ""}, {3: ""}, {1: "?"}, {1: "E", 3: "N"}, {9: "V"}])
def test_a_place_of_no_hemisphere_or_of_before_is_none(tmp_path, tags):
    source = photos(tmp_path / "p")
    for i in (2, 4):
        photo(source / f"IMG_{i + 7}.jpg", i, 47 + i * 1e-5, tags=tags)
    flight, said = import_flight(source, tmp_path / "out")
    assert "photographs without a position, left out: 2" in said
    np.testing.assert_allclose(flight.position[:, 1], [0, 1.112, 3.335, 5.559], atol=1e-2)


def test_a_place_in_degrees_and_minutes(tmp_path):
    source = photos(tmp_path / "p")
    for i in range(6):
        tags = {2: (47.0, 6e-4 * i), 4: (8.0, 30.0), 9: "A"}
        photo(source / f"IMG_{i + 7}.jpg", i, tags=tags)
    flight, _ = import_flight(source, tmp_path / "out")
    np.testing.assert_allclose(flight.origin, (47, 8.5), atol=1e-6)
    np.testing.assert_allclose(np.diff(flight.position[:, 1]), 1.112, atol=1e-2)


def test_times_of_photographs(tmp_path):
    folder = tmp_path / "p"
    folder.mkdir()
    for i in range(9):
        parts = {"subsec": ("100", "433", "767")[i % 3], "time": f"2024:05:01 24:00:0{i // 3}"}
        photo(folder / f"IMG_{i + 6}.jpg", i, 47 + i * 1e-5, **parts)
    flight, _ = import_flight(folder, tmp_path / "out")
    np.testing.assert_allclose(flight.time, [i // 3 + (0, 0.333, 0.667)[i % 3] for i in range(9)])
    assert (np.diff(flight.position[:, 1]) > 0).all()
    assert flight.notes[0] == "time zero is stamp 1714521600100000000 ns of the source"
    for i in range(9):  # a burst without parts of a second, in the order in which people count
        photo(folder / f"IMG_{i + 6}.jpg", i, 47 + i * 1e-5, time=f"2024:05:01 10:00:0{i // 3}")
    flight, _ = import_flight(folder, tmp_path / "burst")
    np.testing.assert_allclose(flight.time, np.arange(9) / 3, atol=1e-6)
    assert (np.diff(flight.position[:, 1]) > 0).all()


def test_photographs_of_two_time_zones_are_joined_in_utc(tmp_path):
    source = photos(tmp_path / "p", time="")
    for i in range(6):
        zone, hour = ("+02:00", 12) if i % 2 else ("-05:30", 4)
        time = f"2024:05:01 {hour:02}:{30 * (i % 2 == 0):02}:{i:02}"
        photo(source / f"IMG_{i + 7}.jpg", i, 47 + i * 1e-5, time=time, subsec="250", zone=zone)
    flight, said = import_flight(source, tmp_path / "out")
    np.testing.assert_allclose(flight.time, np.arange(6))
    assert flight.notes[0] == "time zero is stamp 1714557600250000000 ns of the source"
    assert not any("zone" in line for line in said)
    photo(source / "IMG_8.jpg", 1, 47 + 1e-5, time="2024:05:01 10:00:01", subsec="25")
    again, said = import_flight(source, tmp_path / "again")
    np.testing.assert_allclose(again.time, np.arange(6))
    assert any("1 of 6 photographs tell no time zone: their times are taken as UTC" in line
               for line in said)  # fmt: skip


@pytest.mark.parametrize("time", ["2024:05:01 10:00:60", "yesterday", "    :  :     :  :  "])
def test_a_photograph_without_a_time_is_left_out(tmp_path, time):
    source = photos(tmp_path / "p")
    photo(source / "IMG_9.jpg", 2, 47 + 2e-5, time=time)
    flight, said = import_flight(source, tmp_path / "out")
    np.testing.assert_allclose(flight.time, [0, 1, 3, 4, 5])
    assert "photographs without a time that can be read, left out: 1" in said
    for path in source.iterdir():
        photo(path, 1, 47, time=time)
    flight, said = import_flight(source, tmp_path / "all")
    assert len(flight) == 6 and any("taken as one a second" in line for line in said)


def test_a_photograph_of_elsewhere_is_left_out(tmp_path):
    source = photos(tmp_path / "p")
    photo(source / "IMG_9.jpg", 2, 12.0, 40.0)
    flight, said = import_flight(source, tmp_path / "out")
    np.testing.assert_allclose(np.diff(flight.position[:, 1]), [1.11, 2.22, 1.11, 1.11], atol=0.02)
    assert "photographs more than 100 km from the others, left out: 1" in said


def test_pictures_that_are_cut_short_are_left_out_by_name(tmp_path):
    source = photos(tmp_path / "p")
    cut = [source / f"IMG_{number}.jpg" for number in (9, 8, 7, 10)]
    for file in cut[:3]:
        file.write_bytes(file.read_bytes()[:900] + bytes(3000))
    flight, said = import_flight(source, tmp_path / "out")
    np.testing.assert_allclose(flight.time, [0, 1, 2])
    assert len(list((tmp_path / "out" / "images").iterdir())) == 3
    (line,) = (line for line in said if "cannot be read, left out: 3 (first: " in line)
    assert "IMG_7.jpg: the file is cut short" in line
    assert ("note", line) in preview_import(source)
    cut[3].write_bytes(cut[3].read_bytes()[:900] + bytes(3000))
    with pytest.raises(TrextonError, match=r"IMG_7.jpg: the file is cut short"):
        preview_import(source)


def test_files_that_are_whole_or_left_out(tmp_path):
    source = photos(tmp_path / "p")
    for i, tail in enumerate((bytes(4000), b"SEFH" + bytes(300), b"\0\0\0\x18ftypmp42" * 30)):
        path = source / f"IMG_{i + 7}.jpg"
        path.write_bytes(path.read_bytes() + tail)
    (source / "a.HEIC").write_bytes(b"\0\0\0\x18ftypheic" + bytes(64))
    flight, said = import_flight(source, tmp_path / "out")
    assert len(flight) == 6 and "1 files of .heic were left out: convert them to JPEG" in said


def test_bands_are_one_picture(tmp_path):
    for i in range(5):
        for band in range(1, 6):
            photo(tmp_path / f"IMG_{i}_{band}.jpg", i, 47 + i * 1e-5)
    flight, said = import_flight(tmp_path, tmp_path / "out")
    assert len(flight) == 5 and any(line.startswith("5 bands of one shutter") for line in said)


@pytest.mark.parametrize("time", ["2024:05:01 10:00:00", "", None])
def test_a_counter_that_begins_anew_goes_on(tmp_path, time):
    numbers = [9997, 9998, 9999, 1, 2, 3]
    for i, number in enumerate(numbers):
        taken = {"time": f"2024:05:01 10:00:{50 - 5 * i}" if time is None else time}
        photo(tmp_path / f"DJI_{number:04}.JPG", i, 47 + i * 1e-5, **taken)
    flight, _ = import_flight(tmp_path, tmp_path / "out")
    north = 1.112 * np.arange(6)
    expected = north[::-1] if time is None else north  # where stamps tell, they tell
    np.testing.assert_allclose(flight.position[:, 1], expected, atol=1e-2)


def test_photographs_that_look_ahead_are_of_the_gimbal(tmp_path):
    angles = 'd:GimbalPitchDegree="-40" d:GimbalYawDegree="0" d:GimbalRollDegree="0"'
    source = photos(tmp_path / "p", xmp=f"<a {angles}/>".encode())
    _, said = import_flight(source, tmp_path / "out")
    for lines in (said, check_flight(tmp_path / "out").warnings):
        (line,) = (line for line in lines if "50 degrees from straight down" in line)
        assert "a gimbal that was not at -90 degrees" in line and "--quaternion" not in line


def test_reconstructions_have_positions_and_attitude(tmp_path):
    source = photos(tmp_path / "p")
    # A camera that looks down from (i, 2, 5): x to the right, y (of the picture) to -y.
    colmap = ["# Image list", "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME"]
    for i in range(6):
        colmap += [f"{i + 1} 0 1 0 0 {-i} 2 5 1 images/IMG_{i + 7}.jpg", "1.0 2.0 -1"]
    (tmp_path / "images.txt").write_text("\n".join(colmap))
    (tmp_path / "bare.txt").write_text("\n".join(colmap[2:]))
    shots = {f"IMG_{i + 7}.jpg": {"rotation": [np.pi, 0, 0], "translation": [-i, 2, 5]}
             for i in range(6)}  # fmt: skip
    (tmp_path / "reconstruction.json").write_text(json.dumps([{"shots": shots}]))
    for name in ("images.txt", "bare.txt", "reconstruction.json"):
        chosen = {"positions": str(tmp_path / name)}
        flight, _ = import_flight(source, tmp_path / f"out-{name}", settings=chosen)
        np.testing.assert_allclose(flight.position, [[i, 2] for i in range(6)], atol=1e-9)
        np.testing.assert_allclose(flight.height, 5)
        np.testing.assert_allclose(flight.attitude, 0, atol=1e-9)


def test_of_pairs_of_two_sizes_the_larger_is_kept(tmp_path):
    from PIL import Image

    source = photos(tmp_path / "p")
    for path in list(source.iterdir()):
        image = Image.open(path)
        image.resize((40, 32)).save(source / f"A_{path.stem}_T.jpg", exif=image.getexif())
    flight, said = import_flight(source, tmp_path / "out")
    assert len(flight) == 6 and flight.image(0).shape == (48, 64, 3)
    assert any("another size than 64x48, left out: 6" in line for line in said)


def test_a_list_of_poses_without_its_lines_of_points_is_whole(tmp_path):
    rows = [f"{i + 1} 0 1 0 0 {-i} 2 5 1 IMG_{i + 7}.jpg" for i in range(6)]
    text = "# IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME\n" + "\n".join(rows)
    (tmp_path / "images.txt").write_text(text)
    chosen = {"positions": str(tmp_path / "images.txt")}
    flight, _ = import_flight(photos(tmp_path / "p"), tmp_path / "out", settings=chosen)
    np.testing.assert_allclose(flight.position, [[i, 2] for i in range(6)], atol=1e-9)


def test_a_tiff_of_many_bands_is_named(tmp_path):
    from PIL import Image

    for i in range(4):
        Image.fromarray(picture(i)).save(path := tmp_path / f"{i}.tif")
        data = path.read_bytes().replace(b"\x15\x01\x03\0\1\0\0\0\3", b"\x15\x01\x03\0\1\0\0\0\5")
        path.write_bytes(data)
    with pytest.raises(TrextonError, match=r"0.tif: .*TIFF of over four bands"):
        import_flight(tmp_path, tmp_path / "out", kind="photos")


def test_a_tiff_of_many_pages_is_no_image_and_one_with_an_overview_is(tmp_path):
    from PIL import Image

    for size, name in ((48, "pages.tif"), (24, "overview.tif")):
        pages = [Image.fromarray(picture(0, each)) for each in ((64, 48), (64 * size // 48, size))]
        pages[0].save(tmp_path / name, save_all=True, append_images=pages[1:])
    assert read_image(tmp_path / "overview.tif").shape == (48, 64, 3)
    for read in (read_image, read_picture):
        with pytest.raises(ImageError, match=r"pages.tif: the file holds several pages"):
            read(tmp_path / "pages.tif")


def test_of_several_reconstructions_the_largest_is_taken(tmp_path):
    source = photos(tmp_path / "p")
    shots = {f"IMG_{i + 7}.jpg": {"rotation": [np.pi, 0, 0], "translation": [-i / 2, 0, 10]}
             for i in range(6)}  # fmt: skip
    parts = [{"shots": dict([*shots.items()][chosen])} for chosen in (slice(2), slice(2, 6))]
    (source / "reconstruction.json").write_text(json.dumps(parts))
    flight, said = import_flight(
        source, tmp_path / "out", settings={"positions": "reconstruction.json"}
    )
    np.testing.assert_allclose(flight.position[:, 0], [1, 1.5, 2, 2.5])
    assert any("4 poses of a reconstruction, the largest of 2 in it" in line for line in said)
    assert "photographs without a position, left out: 2" in said
