"""What `fuzzing` damages: each kind of file that is read, with sound ones to begin from."""

from __future__ import annotations

import hashlib
import io
import json
import os
import re
import tempfile
from collections.abc import Callable
from pathlib import Path
from unittest import mock

import cv2
import numpy as np
from small_logs import ardupilot_log, px4_log, subtitles
from small_recording import film

from trexton.base.records import Record
from trexton.cli.replay import replayed
from trexton.companion.build.sweep import read_plan
from trexton.flights.check import check_flight
from trexton.flights.flight import Flight
from trexton.flights.importers import importer
from trexton.flights.writing import write_flight
from trexton.localization.map_files import load_map, save_map
from trexton.localization.training import train_map
from trexton.vision.calibration import read_calibration
from trexton.vision.images import read_image


def small() -> Flight:
    rng = np.random.default_rng(3)
    return Flight(
        name="small",
        frame=np.arange(12),
        time=np.arange(12) * 0.4,
        position=rng.uniform(0, 2, (12, 2)),
        area=(0.0, 2.0, 0.0, 2.0),
        histograms=rng.dirichlet(np.ones(4), 12),
        split={"train": (0, 7), "test": (8, 11)},
    )


def _flight_file(name: str, folder: Path) -> Callable[[bytes], object]:
    flight = write_flight(small(), folder / "flight")

    def target(data: bytes) -> object:
        (flight / name).write_bytes(data)
        return str(check_flight(flight))

    return target


def _file(name: str, folder: Path, read: Callable[[Path], object]) -> Callable[[bytes], object]:
    def target(data: bytes) -> object:
        (folder / name).write_bytes(data)
        return read(folder / name)

    return target


def _importer(kind: str, name: str, folder: Path, whole: bool = False, **settings: object):
    """Reads the file `name` by an importer, or the `whole` folder with the file in its place."""
    module = importer(kind)

    def read(path: Path) -> object:
        where = folder if whole else path
        return module.read(where, module.Settings(**settings))

    return _file(name, folder, read)


CALIBRATION = b"""%YAML:1.0
---
image_width: 64
image_height: 48
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 50., 0., 32., 0., 50., 24., 0., 0., 1. ]
distortion_coefficients: !!opencv-matrix
   rows: 1
   cols: 5
   dt: d
   data: [ 0.1, 0., 0., 0., 0. ]
"""
SENSOR = b"""sensor_type: camera
resolution: [64, 48]
camera_model: pinhole
intrinsics: [50.0, 50.0, 32.0, 24.0]
distortion_model: radial-tangential
distortion_coefficients: [0.1, 0.0, 0.0, 0.0]
"""
LOG = b"""{"event": "start", "time_s": null, "unix_s": 1.0, "clock_s": 2.0, "map": {}}
{"time_s": 0, "measurement_m": [1, 2], "observed": true, "lost": false, "stale": false, "fault": ""}
{"event": "link", "time_s": 0.2, "output": "udpout", "state": "heard"}
{"event": "end", "time_s": 0.3, "frames": 1}
"""


def _photograph(folder: Path) -> bytes:
    """A JPEG that says in EXIF and XMP where and when it was taken, beside two others."""
    from PIL import ExifTags, Image

    xmp = (
        b'<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/'
        b'22-rdf-syntax-ns#"><rdf:Description drone-dji:RelativeAltitude="+10.5" '
        b'drone-dji:GimbalPitchDegree="-90.0" drone-dji:GimbalYawDegree="12.5"/></rdf:RDF>'
        b"</x:xmpmeta>"
    )
    for name, minutes in (("b.jpg", 2.0), ("c.jpg", 3.0), ("a.jpg", 1.0)):
        exif = Image.Exif()
        exif[ExifTags.Base.DateTime] = f"2026:01:01 00:0{minutes:.0f}:00"
        exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.DateTimeOriginal] = "2026:01:01 00:00:00"
        place = {1: "N", 2: (52.0, minutes, 0.0), 3: "E", 4: (4.0, 0.0, 0.0)}
        exif.get_ifd(ExifTags.IFD.GPSInfo).update(place)
        stream = io.BytesIO()
        Image.new("RGB", (32, 24)).save(stream, "JPEG", exif=exif, xmp=xmp)
        (folder / name).write_bytes(stream.getvalue())
    return stream.getvalue()


def _encoded(suffix: str) -> bytes:
    rng = np.random.default_rng(0)
    return cv2.imencode(suffix, rng.integers(0, 256, (24, 32, 3), dtype=np.uint8))[1].tobytes()


# Their files would be made anew at whatever place a mutation names.
_FILES = ("csv", "json", "tum")


def _sink(folder: Path) -> Callable[[bytes], object]:
    from trexton.onboard.fix import LocalFrame
    from trexton.onboard.sinks import Surroundings, open_sink
    from trexton.onboard.tally import Tally

    around = Surroundings(LocalFrame(), (0.0, 2.0, 0.0, 2.0), np.eye(2), Tally())

    def target(data: bytes) -> object:
        address = _word(data)
        kind, colon, rest = address.partition(":")
        if kind in _FILES and rest:
            address = f"{kind}:{folder / ('f' + rest.replace('/', '_'))}"
        return open_sink(address, around)

    return target


def _source(folder: Path) -> Callable[[bytes], object]:
    from trexton.onboard.sources import open_source

    def target(data: bytes) -> object:
        address = _word(data).replace("FLIGHT", str(folder))
        if re.match("stream:", address):
            return address  # sound: it would open what is there
        return open_source(address)

    return target


def _picture(folder: Path, record: Path) -> tuple[Callable[[bytes], object], list[bytes]]:
    """A record's picture, which the record says is the right one."""
    content = json.loads(record.read_bytes())
    (entry,) = content["images"].values()
    seeds = [(record.parent / entry["file"]).read_bytes(), _encoded(".jpg"), _encoded(".tiff")]

    def target(data: bytes) -> object:
        entry.update(file="own.png", sha256=hashlib.sha256(data).hexdigest())
        (folder / "own.png").write_bytes(data)
        (folder / "own.json").write_text(json.dumps(content))
        return Record.load(folder / "own.json")

    return target, seeds


PLAN = b"""experiment = "mocap_training"
flights = ["plain", "other"]
[set]
particles = 10
neighbors = [2, 3]
"""


def _word(data: bytes) -> str:
    """As a shell hands it over."""
    return data.replace(b"\0", b"").decode("utf-8", "surrogateescape")


def _euroc(folder: Path) -> bytes:
    for place in ("cam0", "vicon0"):
        (folder / "mav0" / place).mkdir(parents=True)
    rows = ["#timestamp [ns],filename", *(f"{i * 10**8},{i}.png" for i in range(5))]
    (folder / "mav0" / "cam0" / "data.csv").write_text("\n".join(rows))
    header = "#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_w, q_x, q_y, q_z"
    return "\n".join([header, *(f"{i * 10**8},{i},2,1,1,0,0,0" for i in range(5))]).encode()


def _video(folder: Path) -> bytes:
    shades = (np.full((24, 32, 3), shade, np.uint8) for shade in (40, 120, 200))
    return film(folder / "sound.avi", shades, 2.0).read_bytes()


def _bag_file(folder: Path) -> Callable[[bytes], object]:
    """Reads a bag of the container that its first bytes name, every image too."""
    module = importer("bag")

    def target(data: bytes) -> object:
        suffixes = {b"#ROS": ".bag", b"SQLi": ".db3", b"\x89MCA": ".mcap"}
        suffix = next((each for head, each in suffixes.items() if data.startswith(head)), ".bag")
        path = folder / f"b{suffix}"
        path.write_bytes(data)
        recording = module.read(path, module.Settings())
        return [recording.frames[i] for i in range(len(recording.frames))]

    return target


def _bags() -> list[bytes]:
    """Sound ones of every container: ROS 1, and SQLite and MCAP of ROS 2."""
    from rosbags import rosbag1, rosbag2
    from rosbags.typesys import Stores, get_typestore

    def written(open_writer, store, serialize: str, *sequence: int) -> bytes:
        types, serialized = store.types, getattr(store, serialize)
        with tempfile.TemporaryDirectory() as place:
            with open_writer(Path(place) / "x.bag") as writer:
                kinds = "sensor_msgs/msg/Image", "geometry_msgs/msg/PoseStamped"
                topics = [
                    writer.add_connection(name, kind, typestore=store)
                    for name, kind in zip(("/camera", "/pose"), kinds, strict=True)
                ]
                for second in (1, 2):
                    stamp = types["builtin_interfaces/msg/Time"](second, 0)
                    head = types["std_msgs/msg/Header"](*sequence, stamp, "")
                    pixels = np.full(8 * 6, 40 * second, np.uint8)
                    point = types["geometry_msgs/msg/Point"](float(second), 2.0, 1.0)
                    turn = types["geometry_msgs/msg/Quaternion"](1.0, 0.0, 0.0, 0.0)
                    messages = (
                        types[kinds[0]](head, 6, 8, "mono8", 0, 8, pixels),
                        types[kinds[1]](head, types["geometry_msgs/msg/Pose"](point, turn)),
                    )
                    for topic, kind, message in zip(topics, kinds, messages, strict=True):
                        writer.write(topic, second * 10**9, serialized(message, kind))
            files = [Path(place) / "x.bag", *Path(place).glob("x.bag/*.[md][cb]*")]
            return next(each for each in files if each.is_file()).read_bytes()

    def second(plugin):
        return lambda path: rosbag2.Writer(path, version=9, storage_plugin=plugin)

    ros1, ros2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_HUMBLE)
    containers = rosbag2.StoragePlugin
    return [
        written(rosbag1.Writer, ros1, "serialize_ros1", 0),
        written(second(containers.SQLITE3), ros2, "serialize_cdr"),
        written(second(containers.MCAP), ros2, "serialize_cdr"),
    ]


def _tracks() -> list[bytes]:
    """Positions as motion capture, ArduPilot and PX4 write them, and subtitles of a video."""
    motive = "Format Version,1.23,Length Units,Meters\n\n,,Rigid Body" + ",Rigid Body" * 6 + "\n"
    motive += ",,drone" + ",drone" * 6 + "\n,,1" + ",1" * 6 + "\n,,Rotation" + ",Rotation" * 3
    motive += ",Position" * 3 + "\nFrame,Time (Seconds),X,Y,Z,W,X,Y,Z\n"
    motive += "".join(f"{i},{i / 10},0,0,0,1,{i},1,2\n" for i in range(6))
    return [motive.encode(), ardupilot_log(6), px4_log(6), subtitles(6).encode()]


def _track(folder: Path) -> Callable[[bytes], object]:
    from trexton.flights.importers.tracks import TrackColumns, read_track

    def target(data: bytes) -> object:
        suffixes = {b"\xa3\x95": ".bin", b"ULog": ".ulg", b"Form": ".csv"}
        suffix = next((each for head, each in suffixes.items() if data.startswith(head)), ".srt")
        (folder / f"track{suffix}").write_bytes(data)
        return read_track(folder / f"track{suffix}", TrackColumns())

    return target


def _cache(folder: Path) -> tuple[Callable[[bytes], object], bytes]:
    """Asks for a result whose file was damaged: it must come back as it was computed."""
    from trexton.base import cache

    def compute() -> dict[str, np.ndarray]:
        return {"a": np.arange(6.0), "b": np.eye(2, dtype=np.uint8)}

    def ask() -> dict[str, np.ndarray]:
        with mock.patch.dict(os.environ, TREXTON_CACHE=str(folder / "cache")):
            return cache.cached("thing", "trexton.base.errors", {}, compute)

    ask()
    (file,) = (folder / "cache").glob("*.npz")

    def target(data: bytes) -> object:
        file.write_bytes(data)
        found, whole = ask(), compute()
        if list(found) != list(whole) or not all((found[k] == whole[k]).all() for k in whole):
            raise AssertionError("other arrays than were computed")
        return found

    return target, file.read_bytes()


def targets(folder: Path) -> dict[str, tuple[Callable[[bytes], object], list[bytes]]]:
    """Each target by name, with sound inputs to begin from."""
    parts = {
        name: folder / name for name in ("toml", "frames", "hist", "map", "euroc", "tum", "photos")
    }
    for part in parts.values():
        part.mkdir()
    sound = write_flight(small(), folder / "sound")
    table = {name: (sound / name).read_bytes() for name in ("flight.toml", "frames.csv")}
    texton_map = train_map(small(), neighbors=2, rng=np.random.default_rng(1))
    map_bytes = save_map(texton_map, folder / "sound.npz").read_bytes()
    field_map = train_map(small(), method="field", rng=np.random.default_rng(1))
    field_bytes = save_map(field_map, folder / "field.npz").read_bytes()
    picture = {"p": np.eye(4, dtype=np.uint8)}
    record = Record("e", "f", {"a": 1}, {"b": 2.0}, {"time_s": [0.0, 1.0]}, picture)
    record_file = record.save(folder)
    record_bytes = record_file.read_bytes()
    cache_target, cache_bytes = _cache(folder)
    (folder / "p.csv").write_text("t,x,y\n0,1,2\n1,1,2\n2,1,3\n")
    camera = (
        b'\n[camera]\nwidth_px = 32\nheight_px = 24\nfocal_px = 20.0\n[floor]\nimage = "f.png"\n'
        b"world_from_pixel = [[1, 0, 0], [0, -1, 0], [0, 0, 1]]\n"
    )
    euroc = _euroc(parts["euroc"])
    track = b"# stamp x y z qx qy qz qw\n" + b"".join(b"%d.5 1 2 3 0 0 0 1\n" % i for i in range(5))
    (parts["tum"] / "rgb.txt").write_text("".join(f"{i}.5 rgb/{i}.png\n" for i in range(5)))
    rows = b"t,x,y,image\n" + b"".join(b"%d,1.5,2,a%d.png\n" % (i, i) for i in range(5))
    values = b"x,y,a,b,c,d\n" + b"".join(b"%d,1,.1,.2,.3,.4\n" % i for i in range(5))
    return {
        "flight.toml": (
            _flight_file("flight.toml", parts["toml"]),
            [table["flight.toml"], table["flight.toml"] + camera],
        ),
        "frames.csv": (_flight_file("frames.csv", parts["frames"]), [table["frames.csv"]]),
        "histograms.csv": (
            _flight_file("histograms.csv", parts["hist"]),
            [(sound / "histograms.csv").read_bytes()],
        ),
        "image": (
            _file("i.png", folder, read_image),
            [_encoded(s) for s in (".png", ".jpg", ".bmp", ".webp", ".tiff")],
        ),
        "map": (_file("m.npz", parts["map"], load_map), [map_bytes, field_bytes]),
        "cache": (cache_target, [cache_bytes]),
        "record": (_file("r.json", folder, Record.load), [record_bytes]),
        "record picture": _picture(folder, record_file),
        "plan": (_file("plan.toml", folder, read_plan), [PLAN]),
        "import euroc": (_importer("euroc", "mav0/vicon0/data.csv", parts["euroc"], True), [euroc]),
        "import tum": (_importer("tum", "groundtruth.txt", parts["tum"], True), [track]),
        "import csv": (_importer("csv", "t.csv", folder), [rows]),
        "import features": (_importer("features", "v.csv", folder), [values]),
        "import video": (
            _importer("video", "v.avi", folder, positions="p.csv", offset=0.0),
            [_video(folder)],
        ),
        "import photos": (
            _importer("photos", "a.jpg", parts["photos"], True),
            [_photograph(parts["photos"])],
        ),
        "track": (_track(folder), _tracks()),
        "calibration": (_file("c.yaml", folder, read_calibration), [CALIBRATION, SENSOR]),
        "log": (_file("log", folder, lambda path: [*replayed(path)]), [LOG]),
        "sink address": (
            _sink(folder),
            [
                b"csv:a.csv",
                b"json",
                b"tum:t",
                b"udpout:127.0.0.1:14550",
                b"udpin:0.0.0.0:14550",
                b"serial:/dev/ttyS0:57600",
            ],
        ),
        "source address": (
            _source(sound),
            [
                b"FLIGHT",
                b"FLIGHT#test",
                b"/dev/video0",
                b"rtsp://localhost:1/x",
                b"flight:FLIGHT",
            ],
        ),
        "import bag": (_bag_file(folder), _bags()),
    }
