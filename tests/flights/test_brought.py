"""What people bring: faults of real recordings are mended or named, and sound ones pass."""

from __future__ import annotations

import struct
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import small_flight
from test_import import picture
from test_import_odd import table

from trexton.base.errors import FlightError
from trexton.cli import main as cli
from trexton.flights.check import check_flight, repair_flight
from trexton.flights.folder import read_flight
from trexton.flights.importers import guess_kind
from trexton.flights.importing import import_flight, preview_import
from trexton.flights.plausibility import warnings
from trexton.flights.writing import write_flight

N = 10**9


def place(i: float) -> tuple[float, float]:
    """In a room whose origin is a corner."""
    return float(5 + 2 * np.cos(i / 8)), float(4 + 2 * np.sin(i / 8))


def bag(
    path: Path,
    stamped=True,
    constant=0,
    encoding="mono8",
    ros2=False,
    zero_turns=(),
    cut=(),
    rows=range(8),
) -> Path:
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
        for i in rows:
            now = 1_700_000_000 * N + i * N // 20
            x, y = place(i)
            pose = kinds["geometry_msgs/msg/Pose"](
                position=kinds["geometry_msgs/msg/Point"](x=x, y=y, z=1.0),
                orientation=kinds["geometry_msgs/msg/Quaternion"](
                    x=float(i not in zero_turns), y=0.0, z=0.0, w=0.0
                ),
            )
            at = header(now if stamped else constant)
            message = kinds["geometry_msgs/msg/PoseStamped"](header=at, pose=pose)
            writer.write(poses, now, packed(message, "geometry_msgs/msg/PoseStamped"))
            pixels = picture(i)[..., 0]
            if encoding.endswith("16"):
                pixels = pixels.astype("<u2") * 257
            raw = np.frombuffer(np.ascontiguousarray(pixels).tobytes(), np.uint8)
            message = kinds["sensor_msgs/msg/Image"](
                header=at, height=48, width=64, encoding=encoding, is_bigendian=0,
                step=len(raw) // 48, data=raw[:-1] if i in cut else raw,
            )  # fmt: skip
            writer.write(images, now, packed(message, "sensor_msgs/msg/Image"))
    return path


def test_images_of_a_bag_that_are_cut_are_left_out(tmp_path):
    flight, said = import_flight(bag(tmp_path / "b.bag", cut=(0, 5)), tmp_path / "out")
    (line,) = [each for each in said if "left out" in each]
    assert line.startswith("images that cannot be read, left out: 2 (first: message 1: ")
    assert "an image of /image is shorter than its 64x48 pixels" in line
    assert len(flight) == 6
    grey = [picture(row)[..., 0].mean() for row in (1, 2, 3, 4, 6, 7)]
    np.testing.assert_allclose([each[..., 0].mean() for each in flight.images()], grey, atol=1)
    np.testing.assert_allclose(flight.position[0], place(1), atol=1e-6)
    with pytest.raises(FlightError, match="an image of /image is shorter than its 64x48 pixels"):
        import_flight(bag(tmp_path / "c.bag", cut=range(5)), tmp_path / "most")


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
    flight, said = import_flight(bag(tmp_path / "c.bag", False, 7 * N), tmp_path / "constant")
    assert len(flight) == 8 and any("bag's own times" in line for line in said)
    source = bag(tmp_path / "two", ros2=True) / "two.mcap"
    assert guess_kind(source) == "bag"
    assert len(import_flight(source, tmp_path / "mcap")[0]) == 8
    flight, said = import_flight(bag(tmp_path / "z.bag", zero_turns=(3,)), tmp_path / "zero")
    assert any("1 rows without an attitude, left out" in line for line in said)
    assert np.isfinite(flight.position[3]).all()  # between its neighbours


@pytest.mark.parametrize("kind", ["bag", "mcap"])
def test_a_folder_of_the_pieces_of_a_bag(tmp_path, kind):
    """As recording by size or time leaves them, without the metadata of ROS 2."""
    folder = tmp_path / "split"
    folder.mkdir()
    for number, rows in ((0, range(3)), (1, range(3, 8)), (2, range(2))):
        made = bag(tmp_path / f"{number}.{kind}", ros2=kind == "mcap", rows=rows)
        piece = next(made.glob("*.mcap")) if made.is_dir() else made
        piece.rename(folder / f"split_{number}.{kind}")
        if number == 1:
            flight, _ = import_flight(folder, tmp_path / "out")
            np.testing.assert_allclose(flight.time, np.arange(8) / 20)
            np.testing.assert_allclose(flight.position, [place(i) for i in range(8)])
            whole, _ = import_flight(bag(tmp_path / "whole.bag"), tmp_path / "whole")
            for row in range(8):
                np.testing.assert_array_equal(flight.image(row), whole.image(row))
    with pytest.raises(FlightError, match="its files overlap or lie apart"):
        import_flight(folder, tmp_path / "copies")
    (folder / f"split_2.{kind}").unlink()
    assert len(import_flight(folder, tmp_path / "again")[0]) == 8


def test_a_piece_of_a_bag_that_is_named_twice_is_refused(tmp_path):
    """It would give its messages as often as it is named."""
    source = bag(tmp_path / "two", ros2=True) / "two.mcap"
    (tmp_path / "two" / "metadata.yaml").unlink()
    data, length = source.read_bytes(), struct.Struct("<Q")
    (summary,) = length.unpack_from(data, len(data) - 8 - 20)
    at = data.index(b"\x08", summary)
    while data[at] != 8 or at + 9 + length.unpack_from(data, at + 1)[0] > len(data):
        at = data.index(b"\x08", at + 1)
    entry = data[at : at + 9 + length.unpack_from(data, at + 1)[0]]
    source.write_bytes(data[:at] + entry + data[at:])
    with pytest.raises(FlightError, match=r"two\.mcap: .*its index names .* twice"):
        import_flight(source, tmp_path / "out")


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


@pytest.mark.parametrize(
    ("stamp", "expected"),
    [
        (lambda i: f"2024-05-01 10:00:{i / 12:06.3f}", np.arange(24).round() / 12),
        (lambda i: f"2024-05-01T12:00:{i / 12:06.3f}+02:00", np.arange(24) / 12),
        (
            lambda i: (
                f"2024/5/1 {11 + i // 12}:{59 - i // 12 * 59:02}:{(59 + i / 12) % 60:06.3f} "
                f"{'ap'[i // 12]}.m."
            ),
            np.arange(24) / 12,
        ),
        (
            lambda i: f"{12 + i // 12 * -11}:{59 - i // 12 * 59:02}:{(59 + i / 12) % 60:06.3f} PM",
            np.arange(24) / 12,
        ),
        (lambda i: f"0:10:{i / 12:06.3f}", np.arange(24) / 12),
        (lambda i: str(1714557600 + i // 12), np.arange(24) / 12),
        (lambda i: f"{i // 3 * 0.25:.2f}", np.arange(24) / 12),
    ],
)
def test_stamps_as_people_write_them(tmp_path, stamp, expected):
    rows = [f"{stamp(i)},{','.join(map(str, place(i)))},{i % 6}.png" for i in range(24)]
    flight, _ = import_flight(table(tmp_path / "t", rows), tmp_path / "out")
    np.testing.assert_allclose(flight.time, expected, atol=1e-3)
    np.testing.assert_allclose(flight.position, [place(i) for i in range(24)])


def test_one_stamp_for_all_is_refused(tmp_path):
    rows = [f"5.0,{','.join(map(str, place(i)))},{i % 6}.png" for i in range(24)]
    with pytest.raises(FlightError, match=r"24 rows of positions, each stamp at several places"):
        import_flight(table(tmp_path / "t", rows), tmp_path / "out")


def test_repairs_do_not_take_one_unit_for_another(tmp_path):
    time = np.arange(200) * 0.08
    position = np.column_stack([5 + 2 * np.cos(1.5 * time), 4 + 2 * np.sin(1.5 * time)])
    area = (2.9, 7.1, 1.9, 6.1)
    quick = replace(small_flight(200), time=time, position=position, area=area)
    flight = replace(quick, position=100 * position, area=tuple(100 * np.array(area)))
    done = repair_flight(write_flight(flight, tmp_path / "cm"), tmp_path / "cm2")
    assert done == ["positions and area read as centimetres"]
    days = replace(quick, time=time / 86400)
    done = repair_flight(write_flight(days, tmp_path / "days"), tmp_path / "days2")
    assert done == ["stamps read as days"]
    np.testing.assert_allclose(read_flight(tmp_path / "days2").time, time, atol=1e-9)
    high = replace(quick, height=np.full(200, 39.8), origin=(47.0, 8.0))
    done = repair_flight(write_flight(high, tmp_path / "high"), tmp_path / "high2")
    assert done == ["nothing to repair"]


def test_frames_that_a_repair_leaves_out_are_named(tmp_path):
    rows = [f"{i * 0.08:.2f},{i / 9},1,{min(i, 5)}.png" for i in range(9)]
    import_flight(table(tmp_path / "t", rows), tmp_path / "out")
    cut = tmp_path / "out" / "images" / "000003.png"
    cut.write_bytes(cut.read_bytes()[:40])
    done = repair_flight(tmp_path / "out", tmp_path / "mended")
    assert done[0].startswith("1 frame left out whose image cannot be read")
    assert done[1].endswith("is the one before, or blank (frames.csv, row 8 to 10)")
    np.testing.assert_allclose(read_flight(tmp_path / "mended").frame, [0, 1, 2, 4, 5])


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


def test_columns_of_poses_are_no_features(tmp_path):
    rows = [f"{i / 10},{i / 5},{i},1.5,0.1,{i % 3},{i % 5},{i % 7}" for i in range(20)]
    (tmp_path / "f.csv").write_text("t,x,y,z_m,Yaw,beacon,t0,zone\n" + "\n".join(rows))
    flight, said = import_flight(tmp_path / "f.csv", tmp_path / "a", kind="features")
    assert flight.histograms.shape == (20, 3)
    assert any("columns Yaw, z_m are no features" in line for line in said)
    named = {"time": "t", "z": "z_m", "yaw": "Yaw"}
    flight, said = import_flight(
        tmp_path / "f.csv", tmp_path / "b", kind="features", settings=named
    )
    assert flight.histograms.shape == (20, 3) and not any("features by" in line for line in said)


@pytest.mark.parametrize(
    ("name", "scale"), [("timestamp", 1), ("Seconds", 1), ("time [ms]", 1000), ("rec_time", 1)]
)
def test_a_clock_beside_features_is_none_of_them(name, scale, tmp_path):
    """It was one, that rises through any flight, while frames came at a supposed rate."""
    rows = [f"{i},{scale * i / 4},{i / 5},{i},{i % 3},{i % 5}" for i in range(40)]
    (tmp_path / "f.csv").write_text(f"Unnamed: 0,{name},x,y,a,b\n" + "\n".join(rows))
    flight, said = import_flight(tmp_path / "f.csv", tmp_path / "a", kind="features")
    assert flight.histograms.shape == (40, 2) and flight.time[-1] == pytest.approx(39 / 4)
    assert any(f"stamps of column {name}" in line for line in said)


@pytest.mark.parametrize("digits", [3, 6, 9])
def test_lists_and_trajectories_may_count_in_seconds_and_parts_of_them(tmp_path, digits):
    for i in range(6):
        cv2.imwrite(str(tmp_path / f"{i}.png"), picture(i))
    (tmp_path / "rgb.txt").write_text("".join(f"{15 * 10**8 + i}.25 {i}.png\n" for i in range(6)))
    (tmp_path / "groundtruth.txt").write_text(
        "".join(f"{15 * 10**8 + i}{'250000000'[:digits]} {i} 0 1 1 0 0 0\n" for i in range(6))
    )
    flight, _ = import_flight(tmp_path, tmp_path / "out", kind="tum")
    np.testing.assert_allclose(flight.position[:, 0], np.arange(6.0))
