"""Recordings in other formats become flights: each format is written here by its own tools."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from small_recording import film

from trexton.base.errors import ParameterError, TrextonError
from trexton.flights import importing
from trexton.flights.folder import read_flight
from trexton.flights.frames import ImageFiles
from trexton.flights.importers import IMPORTERS, guess_kind, importer
from trexton.flights.importers.recording import PoseTrack, local_metres
from trexton.flights.importers.video import estimate_offset
from trexton.flights.importing import import_flight

START = 1_403_636_579_763_555_584  # a stamp of EuRoC's, in nanoseconds


def picture(seed: int, size=(64, 48)) -> np.ndarray:
    return np.random.default_rng(seed).integers(0, 256, (size[1], size[0], 3), dtype=np.uint8)


def euroc(folder, frames=6, track="vicon0"):
    data = folder / "mav0" / "cam0" / "data"
    data.mkdir(parents=True)
    stamps = [START + i * 50_000_000 for i in range(frames)]
    rows = ["#timestamp [ns],filename"] + [f"{stamp},{stamp}.png" for stamp in stamps]
    (data.parent / "data.csv").write_text("\n".join(rows))
    for i, stamp in enumerate(stamps):
        cv2.imwrite(str(data / f"{stamp}.png"), picture(i))
    (data.parent / "sensor.yaml").write_text(
        "%YAML:1.0\nresolution: [64, 48]\nintrinsics: [50.0, 52.0, 31.0, 23.0]\n"
        "distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]\n"
    )
    places = folder / "mav0" / track
    places.mkdir()
    header = "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_w, q_x, q_y, q_z"
    half = np.sqrt(0.5)  # a quarter turn to the left
    rows = [
        f"{START + i * 10_000_000},{i * 0.1},{-i * 0.2},1.5,{half},0,0,{half}" for i in range(30)
    ]
    (places / "data.csv").write_text("\n".join([header, *rows]))
    return folder


def test_euroc_keeps_nanoseconds_and_turns(tmp_path):
    flight, said = import_flight(euroc(tmp_path / "MH"), tmp_path / "out")
    assert len(flight) == 6 and flight.camera.focal == 51
    np.testing.assert_array_equal(flight.time, np.arange(6) * 5 / 100)
    np.testing.assert_allclose(flight.position[:, 0], np.arange(6) * 0.5, atol=1e-12)
    # x points forward and to +y: so does the picture's top, as at no yaw
    np.testing.assert_allclose(flight.attitude, 0, atol=1e-12)
    assert "quaternions taken as those of axes flu" in said
    assert "stamps of frames and positions taken as of one clock" in said
    assert any(str(START) in note for note in flight.notes)
    assert any("6 of 6 frames have a position" in line for line in said)


@pytest.mark.parametrize("track", ["mocap0", "leica0", "state_groundtruth_estimate0"])
def test_euroc_finds_its_usual_tracks(tmp_path, track):
    assert len(import_flight(euroc(tmp_path / "MH", track=track), tmp_path / "out")[0]) == 6


def test_undistorting_changes_the_images_and_cropping_the_camera(tmp_path):
    source = euroc(tmp_path / "MH")
    plain, _ = import_flight(source, tmp_path / "plain")
    sensor = str(source / "mav0" / "cam0" / "sensor.yaml")
    settings = {"undistort": sensor, "crop": "0,0,64,40", "scale": 0.5}
    changed, said = import_flight(source, tmp_path / "changed", settings=settings)
    assert changed.image(0).shape == (20, 32, 3) and changed.camera.focal == 25.5
    assert plain.image(0).shape == (48, 64, 3)
    assert "6 images of 32x20" in said


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"undistort": "CALIBRATION"}, "the calibration is for 640x480, the images are 64x48"),
        ({"undistort": "STRAIGHT"}, "no calibration with radial and tangential distortion"),
        ({"crop": "0,0,64"}, "expected x,y,width,height in pixels"),
        ({"crop": "1,0,64,48"}, "the images are 64x48 pixels"),
    ],
)
def test_lenses_and_crops_that_do_not_fit_are_refused(tmp_path, settings, message):
    source = euroc(tmp_path / "MH")
    sensor = (source / "mav0" / "cam0" / "sensor.yaml").read_text()
    (tmp_path / "CALIBRATION").write_text(sensor.replace("64, 48", "640, 480"))
    straight = sensor.replace("-0.28, 0.07, 0.0002, 0.00002", "0, 0, 0, 0")
    (tmp_path / "STRAIGHT").write_text(straight)
    given = {
        name: value if name == "crop" else str(tmp_path / value) for name, value in settings.items()
    }
    with pytest.raises(TrextonError, match=message):
        import_flight(source, tmp_path / "out", settings=given)
    assert not (tmp_path / "out").exists()


def test_frames_out_of_order_are_put_in_order_and_repeated_stamps_dropped(tmp_path):
    plain = import_flight(euroc(tmp_path / "MH"), tmp_path / "plain")[0]
    table = tmp_path / "MH" / "mav0" / "cam0" / "data.csv"
    head, *rows = table.read_text().splitlines()
    table.write_text("\n".join([head, *rows[::-1], rows[2]]))
    flight, said = import_flight(tmp_path / "MH", tmp_path / "out")
    assert "frames put in order of their stamps, 1 of repeated stamps dropped" in said
    np.testing.assert_array_equal(flight.time, plain.time)
    np.testing.assert_array_equal(flight.image(2), plain.image(2))


def test_pictures_of_another_size_are_left_out(tmp_path):
    source = euroc(tmp_path / "MH")
    files = sorted((source / "mav0" / "cam0" / "data").iterdir())
    cv2.imwrite(str(files[1]), cv2.rotate(picture(1), cv2.ROTATE_90_COUNTERCLOCKWISE))
    flight, said = import_flight(source, tmp_path / "out")
    assert {flight.image(row).shape for row in range(5)} == {(48, 64, 3)} and len(flight) == 5
    assert f"images of another size than 64x48, left out: 1 (first: {files[1].name})" in said


def test_tum(tmp_path):
    lines = [f"{1305031102.175304 + i * 0.1:.6f} rgb/{i}.png" for i in range(4)]
    (tmp_path / "rgb.txt").write_text("# color images\n" + "\n".join(lines))
    (tmp_path / "rgb").mkdir()
    for i in range(4):
        cv2.imwrite(str(tmp_path / "rgb" / f"{i}.png"), picture(i))
    places = [f"{1305031102.0 + i * 0.05:.4f} {i} 0 1 0 0 0 1" for i in range(20)]
    (tmp_path / "groundtruth.txt").write_text(
        "# timestamp tx ty tz qx qy qz qw\n" + "\n".join(places)
    )
    flight, _ = import_flight(tmp_path, tmp_path / "out")
    np.testing.assert_allclose(flight.position[:, 0], 3.50608 + 2 * np.arange(4), atol=1e-9)


def test_csv_with_units_and_another_decimal_mark(tmp_path):
    for i in range(3):
        cv2.imwrite(str(tmp_path / f"{i}.png"), picture(i))
    rows = [f"{i},5;{100 * i},0;{-50 * i},0;90;{i}.png" for i in range(3)]
    table = tmp_path / "log.csv"
    table.write_bytes(
        ("\ufefftime;east;north;heading;file\r\n" + "\r\n".join(rows) + "\r\n\r\n").encode()
    )
    settings = {
        "time": "time",
        "x": "east",
        "y": "north",
        "image": "file",
        "yaw": "heading",
        "degrees": "true",
        "unit": "cm",
    }
    flight, _ = import_flight(table, tmp_path / "out", kind="csv", settings=settings)
    np.testing.assert_allclose(flight.position, [[0, 0], [1, -0.5], [2, -1]])
    np.testing.assert_allclose(flight.attitude[:, 2], np.pi / 2)


def test_features_need_not_sum_to_one(tmp_path):
    rng = np.random.default_rng(0)
    values = rng.uniform(0, 0.3, (20, 33))
    header = ",".join(["frame", "x", "y", *(f"f{i}" for i in range(33))])
    rows = [",".join(map(str, (i, i / 10, 1.0, *value))) for i, value in enumerate(values)]
    (tmp_path / "f.csv").write_text("\n".join([header, *rows]))
    flight, _ = import_flight(tmp_path / "f.csv", tmp_path / "out", settings={"split": 0.5})
    np.testing.assert_allclose(flight.histograms, values)
    assert flight.features == "features" and flight.split == {"train": (0, 9), "test": (10, 19)}


@pytest.mark.parametrize("share", [1.0, 0.99, 0.01])
def test_a_split_leaves_frames_for_both_parts(tmp_path, share):
    (tmp_path / "f.csv").write_text(
        "frame,x,y,f0,f1\n" + "".join(f"{i},{i},0,1,2\n" for i in range(20))
    )
    with pytest.raises(ParameterError, match="split .* of 20 frames leaves a part none"):
        import_flight(
            tmp_path / "f.csv", tmp_path / "out", kind="features", settings={"split": share}
        )
    assert not (tmp_path / "out").exists()


def test_photographs_with_exif(tmp_path):
    from PIL import Image

    for i in range(4):
        image = Image.fromarray(picture(i)[..., ::-1])
        exif = Image.Exif()
        exif.get_ifd(0x8825).update(
            {1: "N", 2: (52.0, 0.0, 3.6 * i), 3: "E", 4: (4.0, 22.0, 0.0), 6: 70.0}
        )
        exif.get_ifd(0x8769)[0x9003] = f"2024:05:01 10:00:0{i // 2}"
        image.save(tmp_path / f"p{i}.jpg", exif=exif)
    flight, said = import_flight(tmp_path, tmp_path / "out")
    np.testing.assert_allclose(np.diff(flight.position[:, 1]), 111.27, atol=0.05)  # 0.001 degrees
    assert (np.diff(flight.time) > 0).all()
    assert flight.image(3).shape == (48, 64, 3)


def write_bag(path, container="SQLITE3", packed=None, behind=0, unstamped=(), small=()):
    """`packed` is what is compressed: STORAGE (of MCAP), MESSAGE or FILE; the clock of positions is
    `behind` by so many nanoseconds; of images, some are `unstamped` and some `small`.
    """
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    header = lambda ns: types["std_msgs/msg/Header"](  # noqa: E731
        stamp=types["builtin_interfaces/msg/Time"](sec=ns // 10**9, nanosec=ns % 10**9), frame_id=""
    )
    writing = Writer(path, version=9, storage_plugin=StoragePlugin[container])
    if packed:
        writing.set_compression(CompressionMode[packed], CompressionFormat.ZSTD)
    with writing as writer:
        image = writer.add_connection("/camera", "sensor_msgs/msg/Image", typestore=store)
        odometry = writer.add_connection("/pose", "geometry_msgs/msg/PoseStamped", typestore=store)
        for i in range(5):
            now = START + i * 100_000_000
            pixels = picture(i)[:: 1 + (i in small), :: 1 + (i in small)]
            message = types["sensor_msgs/msg/Image"](
                header=header(0 if i in unstamped else now),
                height=pixels.shape[0],
                width=pixels.shape[1],
                encoding="bgr8",
                is_bigendian=0,
                step=3 * pixels.shape[1],
                data=pixels.reshape(-1),
            )
            writer.write(image, now, store.serialize_cdr(message, "sensor_msgs/msg/Image"))
            pose = types["geometry_msgs/msg/PoseStamped"](
                header=header(now - behind),
                pose=types["geometry_msgs/msg/Pose"](
                    position=types["geometry_msgs/msg/Point"](x=float(i), y=2.0, z=1.0),
                    orientation=types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=0.0, w=1.0),
                ),
            )
            writer.write(odometry, now, store.serialize_cdr(pose, "geometry_msgs/msg/PoseStamped"))


def test_bag(tmp_path):
    write_bag(tmp_path / "bag")
    flight, said = import_flight(tmp_path / "bag", tmp_path / "out")
    np.testing.assert_allclose(flight.position, [[i, 2] for i in range(5)])
    assert "images from /camera, positions from /pose" in said
    with pytest.raises(TrextonError, match="name one of them"):
        import_flight(tmp_path / "bag", tmp_path / "other", settings={"image": "/nothing"})


def write_video(folder, seconds=8.0, rate=25.0, ahead=3.0):
    """A camera over a floor that sways; positions begin `ahead` seconds before the video."""
    floor = cv2.GaussianBlur(
        np.random.default_rng(5).integers(0, 256, (600, 900, 3), np.uint8), (0, 0), 3
    )
    floor = cv2.normalize(floor, None, 0, 255, cv2.NORM_MINMAX)
    place = lambda t: 300 + 60 * np.sin(0.8 * t) + 25 * np.sin(2.1 * t)  # noqa: E731
    lefts = (round(float(place(ahead + i / rate))) for i in range(int(seconds * rate)))
    film(folder / "v.avi", (floor[100:340, left : left + 320] for left in lefts), rate)
    times = np.arange(0, seconds + 2 * ahead, 0.02)
    rows = [f"{t:.3f},{place(t) / 100:.6f},1.0" for t in times]
    (folder / "positions.csv").write_text("\n".join(["t,x,y", *rows]))
    return folder / "v.avi"


def test_video_finds_the_offset_of_its_positions(tmp_path):
    video = write_video(tmp_path)
    settings = {"positions": "positions.csv", "every": 5}
    flight, said = import_flight(video, tmp_path / "out", settings=settings)
    offset = float(said[0].split()[2])
    assert abs(offset - 3.0) < 0.1
    assert len(flight) == 40 and np.isfinite(flight.position).all()
    given, _ = import_flight(video, tmp_path / "given", settings=settings | {"offset": "3"})
    assert np.abs(given.position - flight.position).max() < 0.1


def test_a_video_that_does_not_move_as_the_positions_do_is_refused(tmp_path):
    rng = np.random.default_rng(0)
    stamps = np.arange(100) * 0.04
    track = PoseTrack(
        (np.arange(200) * 2e7).astype(np.int64), rng.normal(0, 1, (200, 3)).cumsum(axis=0)
    )
    assert estimate_offset(stamps, rng.uniform(0, 1, 100), track)[1] < 0.9


def test_kinds_are_guessed_and_described(tmp_path):
    assert guess_kind(euroc(tmp_path / "e")) == "euroc"
    with pytest.raises(TrextonError, match="no such file"):
        guess_kind(tmp_path / "nothing")
    (tmp_path / "x.bin").write_bytes(b"1")
    with pytest.raises(TrextonError, match="name the kind"):
        guess_kind(tmp_path / "x.bin")
    for kind in IMPORTERS:
        assert all(each.meaning for each in importer(kind).Settings.declared())


def test_an_interrupted_import_leaves_nothing(tmp_path, monkeypatch):
    source, read = euroc(tmp_path / "e"), ImageFiles.__getitem__

    def interrupt(frames, row):
        if row == 3:
            raise KeyboardInterrupt
        return read(frames, row)

    monkeypatch.setattr(ImageFiles, "__getitem__", interrupt)
    with pytest.raises(KeyboardInterrupt):
        import_flight(source, tmp_path / "out", settings={"scale": 0.5})
    assert list(tmp_path.iterdir()) == [source]


def test_a_folder_that_is_not_a_flight_is_never_replaced(tmp_path):
    source, out = euroc(tmp_path / "e"), tmp_path / "out"
    out.mkdir()
    (out / "thesis.txt").write_text("all of it")
    with pytest.raises(TrextonError, match="is there already"):
        import_flight(source, out)
    assert (out / "thesis.txt").read_text() == "all of it"
    first, _ = import_flight(source, tmp_path / "flight")
    with pytest.raises(TrextonError, match="--replace"):
        import_flight(source, tmp_path / "flight")
    import_flight(source, tmp_path / "flight", replaced=True)
    assert read_flight(tmp_path / "flight").data_hash == first.data_hash


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("f.csv", b"x,y,a,b,c,d\n1,2,3,4,5,nan\n"),
        ("f.csv", b"x,y,a,b,c,d\n1,2,3\n"),
        ("f.csv", b"\xff\xfe\x00"),
        ("f.csv", b"x,y,a,b,c,d\n"),
        ("v.avi", b"RIFF"),
        ("b.bag", b"#ROSBAG V2.0\n"),
        ("m.csv", b"t,x,y,image\n1,2,3,none.png\n"),
        ("m.csv", b"t,x,y,image\ntoday,2,3,none.png\n"),
    ],
)
def test_damaged_sources_leave_a_sentence_and_nothing_else(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    kind = {"f": "features", "v": "video", "b": "bag", "m": "csv"}[name[0]]
    settings = {"positions": "f.csv"} if kind == "video" else {}
    with pytest.raises(TrextonError):
        import_flight(tmp_path / name, tmp_path / "out", kind=kind, settings=settings)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_what_cannot_be_read_replaces_no_flight(tmp_path):
    header, rows = "frame,x,y,a,b", [f"{i},{i / 10},1,0.5,0.7" for i in range(20)]
    (tmp_path / "f.csv").write_text("\n".join([header, *rows]))
    good, _ = import_flight(tmp_path / "f.csv", tmp_path / "out", kind="features")
    textons = {"features": "textons"}
    with pytest.raises(TrextonError, match="sum") as caught:
        import_flight(
            tmp_path / "f.csv", tmp_path / "out", kind="features", settings=textons, replaced=True
        )
    assert ".importing" not in str(caught.value)
    assert read_flight(tmp_path / "out").data_hash == good.data_hash
    assert {path.name for path in tmp_path.iterdir()} == {"f.csv", "out"}


def test_positions_of_another_time_are_noticed_before_images_are_written(tmp_path, monkeypatch):
    euroc(tmp_path / "source")
    monkeypatch.setattr(importing, "write_images", lambda *_: pytest.fail("images were written"))
    with pytest.raises(TrextonError, match="position"):
        import_flight(tmp_path / "source", tmp_path / "out", settings={"offset": 1e6})
    assert [path.name for path in tmp_path.iterdir()] == ["source"]


def test_stamps_in_milliseconds_since_1970_are_named_with_the_unit_that_they_have(tmp_path):
    for i in range(3):
        cv2.imwrite(str(tmp_path / f"{i}.png"), picture(i))
    rows = [f"{1714550400000 + 80 * i},{i},0,{i}.png" for i in range(3)]
    (tmp_path / "t.csv").write_text("\n".join(["t,x,y,image", *rows]))
    with pytest.raises(
        TrextonError, match=r"t.csv, row 2: t .* the year 2262: give --time-unit ms"
    ):
        import_flight(tmp_path / "t.csv", tmp_path / "out")
    settings = {"time_unit": "ms"}
    flight, _ = import_flight(tmp_path / "t.csv", tmp_path / "out", settings=settings)
    assert flight.time.tolist() == [0, 0.08, 0.16]
    assert flight.notes[0] == "time zero is stamp 1714550400000000000 ns of the source"


def test_degrees_become_metres():
    latitude = np.array([41.2101, 41.2134, 41.2118])
    longitude = np.array([-82.9312, -82.9265, -82.9301])
    place, origin = local_metres(latitude, longitude)
    # A degree of latitude is some 111 km, of longitude less by the cosine.
    np.testing.assert_allclose(place[1] - place[0], (394, 366.5), rtol=3e-3)
    assert (place > -1e-6).all() and origin == (latitude.min(), longitude.min())
