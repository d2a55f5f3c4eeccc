"""What people bring: faults of real recordings are mended or named, and sound ones pass."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import small_flight
from test_import import picture
from test_import_odd import table

from trexton.base.errors import FlightError, TrextonError
from trexton.cli import main as cli
from trexton.flights import read_flight, write_flight
from trexton.flights.check import check_flight, repair_flight
from trexton.flights.importers import guess_kind
from trexton.flights.importers.tracks import TrackColumns, read_track
from trexton.flights.importing import import_flight, preview_import
from trexton.flights.plausibility import warnings

N = 10**9


def place(i: float) -> tuple[float, float]:
    """In a room whose origin is a corner."""
    return float(5 + 2 * np.cos(i / 8)), float(4 + 2 * np.sin(i / 8))


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
    details = exif.get_ifd(0x8769)
    details[0x9003] = how.get("time", f"2024:05:01 10:00:{i:02d}")
    if "subsec" in how:
        details[0x9291] = how["subsec"]
    xmp = {"xmp": how["xmp"]} if "xmp" in how else {}
    Image.fromarray(picture(i)).save(path, "JPEG", exif=exif, **xmp)


def photos(folder: Path, count=6, **how) -> Path:
    folder.mkdir(exist_ok=True)
    for i in range(count):
        photo(folder / f"IMG_{i + 7}.jpg", i, 47 + i * 1e-5, **how)
    return folder


def bag(path: Path, stamped=True, encoding="mono8", ros2=False, zero_turns=()) -> Path:
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE if ros2 else Stores.ROS1_NOETIC)
    kinds = store.types

    def header(stamp):
        time = kinds["builtin_interfaces/msg/Time"](sec=stamp // N, nanosec=stamp % N)
        more = {} if ros2 else {"seq": 0}
        return kinds["std_msgs/msg/Header"](stamp=time, frame_id="", **more)

    writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) if ros2 else Writer1(path)
    packed = store.serialize_cdr if ros2 else store.serialize_ros1
    with writer:
        images = writer.add_connection("/image", "sensor_msgs/msg/Image", typestore=store)
        poses = writer.add_connection("/pose", "geometry_msgs/msg/PoseStamped", typestore=store)
        for i in range(8):
            now = 1_700_000_000 * N + i * N // 20
            x, y = place(i)
            pose = kinds["geometry_msgs/msg/Pose"](
                position=kinds["geometry_msgs/msg/Point"](x=x, y=y, z=1.0),
                orientation=kinds["geometry_msgs/msg/Quaternion"](
                    x=float(i not in zero_turns), y=0.0, z=0.0, w=0.0
                ),
            )
            at = header(now if stamped else 0)
            message = kinds["geometry_msgs/msg/PoseStamped"](header=at, pose=pose)
            writer.write(poses, now, packed(message, "geometry_msgs/msg/PoseStamped"))
            pixels = picture(i)[..., 0]
            if encoding.endswith("16"):
                pixels = pixels.astype("<u2") * 257
            raw = np.frombuffer(np.ascontiguousarray(pixels).tobytes(), np.uint8)
            message = kinds["sensor_msgs/msg/Image"](
                header=at, height=48, width=64, encoding=encoding, is_bigendian=0,
                step=len(raw) // 48, data=raw,
            )  # fmt: skip
            writer.write(images, now, packed(message, "sensor_msgs/msg/Image"))
    return path


@pytest.mark.parametrize("encoding", ["mono8", "8UC1", "mono16", "bayer_rggb8", "bayer_gbrg16"])
def test_encodings_of_bags(tmp_path, encoding):
    flight, _ = import_flight(bag(tmp_path / "b.bag", encoding=encoding), tmp_path / "out")
    grey = picture(3)[..., 0]
    if encoding.startswith("bayer"):
        shown = cv2.cvtColor(grey, cv2.COLOR_BayerBG2BGR if "rggb" in encoding
                             else cv2.COLOR_BayerGR2BGR)  # fmt: skip
        grey = cv2.cvtColor(shown, cv2.COLOR_BGR2GRAY)
    assert np.abs(flight.image(3)[..., 0].astype(int) - grey).mean() < 8  # JPEG


def test_a_bayer_pattern_names_its_first_pixel():
    from trexton.flights.importers.bag import _ENCODINGS

    red = np.zeros((8, 8), np.uint8)
    red[::2, ::2] = 255  # rggb: the first pixel of each four is red
    shown = cv2.cvtColor(red, _ENCODINGS["bayer_rggb8"][2])
    assert shown[4, 4].tolist() == [0, 0, 255]


def test_bags_without_stamps_and_their_files(tmp_path):
    flight, said = import_flight(bag(tmp_path / "b.bag", stamped=False), tmp_path / "out")
    assert len(flight) == 8 and any("bag's own times" in line for line in said)
    np.testing.assert_allclose(flight.time, np.arange(8) / 20)
    source = bag(tmp_path / "two", ros2=True) / "two.mcap"
    assert guess_kind(source) == "bag"
    assert len(import_flight(source, tmp_path / "mcap")[0]) == 8
    flight, said = import_flight(bag(tmp_path / "z.bag", zero_turns=(3,)), tmp_path / "zero")
    assert any("1 rows without an attitude, left out" in line for line in said)
    assert np.isfinite(flight.position[3]).all()  # between its neighbours


def test_lost_tracking_is_named_and_left_out(tmp_path, capsys):
    rows = [f"{i * 0.08:.2f},{x},{y},{i % 6}.png" for i in range(48)
            for x, y in [(0, 0) if i % 8 == 5 else place(i)]]  # fmt: skip
    flight, _ = import_flight(table(tmp_path / "t", rows), tmp_path / "out")
    (said,) = [line for line in check_flight(tmp_path / "out").warnings if "(0, 0)" in line]
    assert "6 positions lie at exactly (0, 0)" in said and "frames 5, 13, 21, 29, 37, 45" in said
    before = sorted((tmp_path / "out").rglob("*"))
    command = ["check", str(tmp_path / "out"), "--repair", "--out", str(tmp_path / "mended")]
    assert cli.main(command) == 0 and "6 positions left empty" in capsys.readouterr().out
    assert sorted((tmp_path / "out").rglob("*")) == before
    mended = read_flight(tmp_path / "mended")
    np.testing.assert_array_equal(np.flatnonzero(~mended.located), np.arange(5, 48, 8))
    assert mended.area[0] > 2.5 and not [each for each in warnings(mended) if "lie at" in each]
    assert len(flight) == len(mended)


def test_stamps_of_positions_that_repeat_or_go_back(tmp_path):
    rows = [f"{i * 0.1:.1f} {i * 0.1} 0 1 1 0 0 0" for i in range(20)]
    text = [*rows[:5], rows[4], *rows[5:9], rows[10], rows[9], *rows[11:], "1.5 9 9 1 1 0 0 0"]
    (tmp_path / "g.txt").write_text("\n".join(text))
    track, said = read_track(tmp_path / "g.txt", TrackColumns())
    assert (np.diff(track.time_ns) > 0).all() and 15 * N // 10 not in track.time_ns
    np.testing.assert_allclose(track.position[:, 0], track.time_ns / N)
    assert "2 rows of positions out of order" in said[0]
    assert "1 row of positions with a repeated stamp dropped (first: row 6)" in said[1]
    assert "rows 17 and 22: one stamp, but places" in said[2]


def test_yaw_in_degrees_is_said_and_read(tmp_path):
    rows = [f"{i * 0.08:.2f},{i / 9},1,{i * 15 % 360},{i % 6}.png" for i in range(24)]
    source = table(tmp_path / "t", rows, "t,x,y,heading,image")
    _, said = import_flight(source, tmp_path / "a", settings={"yaw": "heading"})
    assert any("yaw of up to 345, beyond two turns" in line for line in said)
    assert any("degrees?" in line for line in check_flight(tmp_path / "a").warnings)
    words = ["import", "csv", "--out", str(tmp_path / "b"), "--yaw", "heading", "--degrees"]
    assert cli.main([*words, str(source)]) == 0
    yaw = read_flight(tmp_path / "b").attitude[:, 2]
    np.testing.assert_allclose(np.degrees(yaw[:4]), [0, 15, 30, 45])


@pytest.mark.parametrize(("turn", "said"), [(0, ""), (65, "65 degrees"), (180, "180 degrees")])
def test_a_camera_that_does_not_look_down_is_named(tmp_path, turn, said):
    half = np.radians(turn) / 2
    turned = f"{np.cos(half)} 0 0 {np.sin(half)}"  # about its right, from straight down
    rows = [f"{i / 10} {i} 0 1 {turned}" for i in range(9)]
    (tmp_path / "g.txt").write_text("\n".join(rows))
    track, told = read_track(tmp_path / "g.txt", TrackColumns(axes="camera"))
    assert any(said in line for line in told[1:]) == bool(said)
    flight = replace(
        small_flight(9), position=track.position[:, :2], attitude=track.attitude,
        area=(-1, 9, -1, 1),
    )  # fmt: skip
    assert any("from straight down" in line for line in warnings(flight)) == bool(said)


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
    np.testing.assert_allclose(flight.height, 39.8)
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


def test_files_that_are_whole_or_left_out(tmp_path):
    source = photos(tmp_path / "p")
    for i, tail in enumerate((bytes(4000), b"SEFH" + bytes(300), b"\0\0\0\x18ftypmp42" * 30)):
        path = source / f"IMG_{i + 7}.jpg"
        path.write_bytes(path.read_bytes() + tail)
    (source / "a.HEIC").write_bytes(b"\0\0\0\x18ftypheic" + bytes(64))
    flight, said = import_flight(source, tmp_path / "out")
    assert len(flight) == 6 and "1 files of .heic were left out: convert them to JPEG" in said
    cut = source / "IMG_9.jpg"
    cut.write_bytes(cut.read_bytes()[:900] + bytes(3000))
    with pytest.raises(TrextonError, match="cut short"):
        import_flight(source, tmp_path / "again")


def test_bands_are_one_picture(tmp_path):
    for i in range(5):
        for band in range(1, 6):
            photo(tmp_path / f"IMG_{i}_{band}.jpg", i, 47 + i * 1e-5)
    flight, said = import_flight(tmp_path, tmp_path / "out")
    assert len(flight) == 5 and any(line.startswith("5 bands of one shutter") for line in said)


def test_a_table_names_photographs_with_their_folder(tmp_path):
    source = photos(tmp_path / "p")
    rows = [f"images/IMG_{i + 7}.jpg,{47 + i * 1e-5},8" for i in range(6)]
    (source / "positions.csv").write_text("\n".join(["file,lat,lon", *rows]))
    assert len(import_flight(source, tmp_path / "out")[0]) == 6
    (source / "positions.csv").write_text("file,lat,lon\nother.jpg,47,8\n")
    with pytest.raises(FlightError, match=r"names other.jpg, the folder holds IMG_7.jpg"):
        import_flight(source, tmp_path / "again")


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("images.txt", "{i} {t} img/my image {i}.png"),
        ("rgb.txt", "{t} img/my image {i}.png"),
        ("times.txt", "{i:05d} {t} 0.004"),
    ],
)
def test_lists_of_images(tmp_path, name, line):
    for folder in ("img", "images"):
        (tmp_path / folder).mkdir()
    for i in range(6):
        for path in (f"img/my image {i}.png", f"images/{i:05d}.png"):
            cv2.imwrite(str(tmp_path / path), picture(i))
    (tmp_path / name).write_text("# a list\n" + "".join(line.format(i=i, t=i / 10) + "\n"
                                                        for i in range(6)))  # fmt: skip
    (tmp_path / "groundtruth.txt").write_text(
        "".join(f"{i / 50} {i / 5} 0 1 1 0 0 0\n" for i in range(60))
    )
    flight, _ = import_flight(tmp_path, tmp_path / "out", kind="tum")
    np.testing.assert_allclose(flight.position[:, 0], np.arange(6.0), atol=1e-9)
    numbered = "".join(f"{i} {i / 50} {i / 5} 0 1 1 0 0 0\n" for i in range(60))
    (tmp_path / "groundtruth.txt").write_text("# id timestamp tx ty tz qx qy qz qw\n" + numbered)
    again, _ = import_flight(tmp_path, tmp_path / "again", kind="tum")
    assert again.position.tolist() == flight.position.tolist()


MOTIVE = """Format Version,1.23,Take Name,T,Rotation Type,Quaternion,Length Units,{}

,,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body
,,drone,drone,drone,drone,drone,drone,drone,other
,,1,1,1,1,1,1,1,2
,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Position
Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,X
"""
VICON = """Objects
100
,,Global Angle drone:drone,,,,,,
Frame,Sub Frame,RX,RY,RZ,RW,TX,TY,TZ
,,,,,,mm,mm,mm
"""
QUALISYS = (
    """NO_OF_FRAMES\t60
FREQUENCY\t100
DATA_INCLUDED\t6D
BODY_NAMES\tdrone
Frame\tTime\tdrone X\tdrone Y\tdrone Z\t"""
    + "\t".join(f"Rot[{i}]" for i in range(9))
    + "\n"
)


@pytest.mark.parametrize(
    ("name", "head", "row"),
    [
        ("a.csv", MOTIVE.format("Meters"), "{i},{t},0,0,0,1,{x},1,{b},7"),
        ("b.csv", MOTIVE.format("Millimeters"), "{i},{t},0,0,0,1,{xmm},1000,{bmm},7"),
        ("c.csv", VICON, "{i},0,0,0,0,1,{xmm},{ymm},1000"),
        ("d.tsv", QUALISYS, "{i}\t{t}\t{xmm}\t{ymm}\t1000\t1\t0\t0\t0\t1\t0\t0\t0\t1"),
    ],
)
def test_exports_of_motion_capture(tmp_path, name, head, row):
    rows = []
    for i in range(60):
        x, y = place(i)
        numbers = {"x": x, "b": -y, "xmm": 1000 * x, "ymm": 1000 * y, "bmm": -1000 * y}
        rows.append(row.format(i=i, t=i / 100, **numbers))
    (tmp_path / name).write_text(head + "\n".join(rows) + "\n")
    track, said = read_track(tmp_path / name, TrackColumns(body="drone"))
    np.testing.assert_allclose(track.position[:, :2], [place(i) for i in range(60)])
    np.testing.assert_allclose(track.position[:, 2], 1)
    np.testing.assert_array_equal(track.time_ns, np.arange(60) * N // 100)
    assert "body drone" in said[0] and "axes flu" in said[1]
    np.testing.assert_allclose(np.degrees(track.attitude), [[0, 0, -90]] * 60)
    with pytest.raises(FlightError, match="name one with --body"):
        read_track(tmp_path / name, TrackColumns(body="nobody"))


def test_features_have_a_yaw_and_no_body(tmp_path):
    rows = [f"{i / 9},1,{i},0.{i},0.5,0.2" for i in range(9)]
    (tmp_path / "f.csv").write_text("\n".join(["x,y,turn,a,b,c", *rows]))
    settings = {"yaw": "turn", "degrees": True}
    flight, _ = import_flight(
        tmp_path / "f.csv", tmp_path / "out", kind="features", settings=settings
    )
    np.testing.assert_allclose(np.degrees(flight.attitude[:, 2]), np.arange(9))
    assert flight.histograms.shape == (9, 3)
    with pytest.raises(FlightError, match="no export of motion capture"):
        import_flight(
            tmp_path / "f.csv", tmp_path / "no", kind="features", settings={"body": "drone"}
        )


def test_columns_of_motion_capture_may_be_named(tmp_path):
    rows = [f"{i},{i / 100},0,0,0,1,{i},1,5,7" for i in range(9)]
    (tmp_path / "a.csv").write_text(MOTIVE.format("Meters") + "\n".join(rows) + "\n")
    columns = TrackColumns(time="Time (Seconds)", x="X", y="Z", body="drone")
    assert read_track(tmp_path / "a.csv", columns)[0].position[3, :2].tolist() == [3, 5]


def video(path: Path, frames=40) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*"MJPG"), 20, (64, 48))
    for i in range(frames):
        writer.write(picture(i))
    writer.release()
    return path


def test_subtitles_beside_a_video_and_an_end_that_is_missing(tmp_path):
    path = video(tmp_path / "v.avi")
    data = path.read_bytes()
    path.write_bytes(data[: int(0.6 * len(data))])
    blocks = [
        f"{i + 1}\n00:00:00,{i * 50:03d} --> 00:00:00,{i * 50 + 50:03d}\n"
        f"[latitude: {47 + i * 1e-5:.5f}] [longitude: 8.00000] [rel_alt: 10.{i} abs_alt: 400.0]\n"
        for i in range(20)
    ]
    (tmp_path / "v.SRT").write_text("\n".join(blocks))
    flight, said = import_flight(path, tmp_path / "out")
    assert any("of 40 frames could be decoded: the file is cut short" in line for line in said)
    np.testing.assert_allclose(np.diff(flight.position[:10, 1]), 1.112, atol=0.01)
    assert flight.height[0] == 10 and flight.origin is not None


def ardupilot(path: Path) -> Path:
    """A DataFlash log: formats that describe themselves, and rows."""

    text = b""
    fmt = [(128, b"FMT", b"BBnNZ", b"Type,Length,Name,Format,Columns", 89),
           (1, b"POS", b"QLLff", b"TimeUS,Lat,Lng,Alt,RelHomeAlt", 3 + 24),
           (2, b"ATT", b"QccC", b"TimeUS,Roll,Pitch,Yaw", 3 + 14)]  # fmt: skip
    for number, name, types, columns, length in fmt:
        text += b"\xa3\x95\x80" + struct.pack("<BB4s16s64s", number, length, name, types, columns)
    for i in range(20):
        text += b"\xa3\x95\x01" + struct.pack(
            "<Qiiff", 10**6 + i * 10**5, 470000000 + 100 * i, 80000000, 400, 10
        )
        text += b"\xa3\x95\x02" + struct.pack("<QhhH", 10**6 + i * 10**5, 100, 0, 9000)
    path.write_bytes(text)
    return path


def test_a_log_of_ardupilot(tmp_path):
    track, _ = read_track(ardupilot(tmp_path / "1.bin"), TrackColumns())
    np.testing.assert_allclose(np.diff(track.time_ns), N // 10, atol=1000)
    np.testing.assert_allclose(np.diff(track.position[:, 1]), 1.112, atol=0.01)
    np.testing.assert_allclose(np.degrees(track.attitude[5]), [1, 0, -90], atol=1e-4)
    np.testing.assert_allclose(track.position[:, 2], 10)
    (tmp_path / "2.bin").write_bytes(b"no log")
    with pytest.raises(FlightError, match=r"2\.bin"):
        read_track(tmp_path / "2.bin", TrackColumns())


def test_a_log_of_px4(tmp_path):
    """A file as the format is documented: head, format, subscription, rows."""
    pytest.importorskip("pyulog")
    names = ("x", "y", "z", "heading")
    columns = "uint64_t timestamp;double ref_lat;double ref_lon;"
    columns += "".join(f"float {name};" for name in names) + "bool xy_valid;"

    def message(kind, body):
        return struct.pack("<HB", len(body), ord(kind)) + body

    text = b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0) + message("B", bytes(40))
    text += message("F", f"vehicle_local_position:{columns}".encode())
    text += message("A", struct.pack("<BH", 0, 1) + b"vehicle_local_position")
    for i in range(20):
        row = struct.pack("<QddffffB", 10**5 * i, 47.0, 8.0, i, 2.0, -10.0, np.pi / 2, i > 0)
        text += message("D", struct.pack("<H", 1) + row)
    (tmp_path / "a.ulg").write_bytes(text)
    track, _ = read_track(tmp_path / "a.ulg", TrackColumns())
    np.testing.assert_allclose(track.position, [[2, i, 10] for i in range(1, 20)])
    np.testing.assert_allclose(track.attitude[:, 2], -np.pi / 2, atol=1e-6)
    assert track.origin == (47.0, 8.0) and track.time_ns[0] == N // 10


def test_reconstructions_have_positions_and_attitude(tmp_path):
    source = photos(tmp_path / "p")
    # A camera that looks down from (i, 2, 5): x to the right, y (of the picture) to -y.
    colmap = ["# Image list", "#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME"]
    for i in range(6):
        colmap += [f"{i + 1} 0 1 0 0 {-i} 2 5 1 images/IMG_{i + 7}.jpg", "1.0 2.0 -1"]
    (tmp_path / "images.txt").write_text("\n".join(colmap))
    shots = {f"IMG_{i + 7}.jpg": {"rotation": [np.pi, 0, 0], "translation": [-i, 2, 5]}
             for i in range(6)}  # fmt: skip
    (tmp_path / "reconstruction.json").write_text(json.dumps([{"shots": shots}]))
    for name in ("images.txt", "reconstruction.json"):
        chosen = {"positions": str(tmp_path / name)}
        flight, _ = import_flight(source, tmp_path / f"out-{name}", settings=chosen)
        np.testing.assert_allclose(flight.position, [[i, 2] for i in range(6)], atol=1e-9)
        np.testing.assert_allclose(flight.height, 5)
        np.testing.assert_allclose(flight.attitude, 0, atol=1e-9)


def test_repairs_are_said_and_leave_nothing_to_repair(tmp_path):
    time = np.arange(200) * 0.08
    position = np.column_stack([5 + 2 * np.cos(0.5 * time), 4 + 1.5 * np.sin(0.5 * time)])
    sound = replace(small_flight(200), time=time, position=position, area=(2, 8, 1, 7))
    sound = replace(sound, height=np.full(200, 1.5))
    changes = {
        "positions read as millimetres": {"position": position * 1000},
        "x and y exchanged": {"position": position[:, ::-1], "area": (2.9, 7.1, 2.4, 5.6)},
        "heights turned": {"height": np.full(200, -1.5)},
        "stamps read as milliseconds": {"time": time * 1000},
    }
    for number, (words, change) in enumerate(changes.items()):
        folder = write_flight(replace(sound, **change), tmp_path / str(number))
        done = repair_flight(folder, tmp_path / f"mended-{number}")
        assert len(done) == 1 and words in done[0]
        mended = read_flight(tmp_path / f"mended-{number}")
        np.testing.assert_allclose(mended.position, position)
        np.testing.assert_allclose(mended.time, time)
        np.testing.assert_allclose(mended.height, 1.5)
    write_flight(sound, tmp_path / "odd")
    for name in ("frames.csv", "histograms.csv"):
        rows = (tmp_path / "odd" / name).read_text().splitlines()
        odd = [rows[0], *rows[1:50], rows[51], rows[50], rows[51], *rows[52:]]
        (tmp_path / "odd" / name).write_text("\n".join(odd))
    assert not check_flight(tmp_path / "odd").usable
    done = repair_flight(tmp_path / "odd", tmp_path / "sorted")
    assert "1 of repeated stamps dropped" in done[0]
    mended = read_flight(tmp_path / "sorted")
    assert mended.position.tolist() == sound.position.tolist()
    assert mended.histograms.tolist() == sound.histograms.tolist()


def test_a_preview_writes_nothing(tmp_path, capsys):
    rows = [f"{i / 10},{i},1,{i}.png" for i in range(6)]
    source = table(tmp_path / "t", rows)
    before = sorted(tmp_path.rglob("*"))
    assert cli.main(["import", str(source), "--dry-run"]) == 0
    said = capsys.readouterr().out
    assert "kind        csv (guessed)" in said and "x 0.00 to 5.00, y 1.00 to 1.00" in said
    assert sorted(tmp_path.rglob("*")) == before
    assert dict(preview_import(source, settings={"unit": "cm"}))["unit"] == "cm (as given)"
    assert cli.main(["import", str(source)]) == 1 and "--out" in capsys.readouterr().err


def test_a_calibration_of_kalibr(tmp_path):
    from trexton.vision.calibration import read_calibration

    camera = (
        "{}:\n  camera_model: pinhole\n  distortion_coeffs: [-0.28, 0.07, 0.0002, 0.00001]\n"
        "  distortion_model: radtan\n  intrinsics: [60.0, 60.0, 32.0, {}]\n"
        "  resolution: [64, 48]\n"
    )
    path = tmp_path / "camchain.yaml"
    path.write_text(camera.format("cam0", 24) + camera.format("cam1", 25))
    found, distortion = read_calibration(path)
    assert (found.width, found.focal, found.center) == (64, 60, (32, 24))
    np.testing.assert_allclose(distortion, [-0.28, 0.07, 0.0002, 0.00001])
    assert read_calibration(path, "cam1")[0].center == (32, 25)
