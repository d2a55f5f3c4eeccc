"""ROS 1 and ROS 2 bags. An image topic is read, and one of poses or odometry."""

import re
import sqlite3
from bz2 import BZ2Decompressor
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from importlib import import_module
from itertools import pairwise
from operator import attrgetter
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

import cv2
import numpy as np

from trexton.base.errors import FlightError
from trexton.base.options import Options, option
from trexton.base.pictures import MOST_PIXELS, damage, decode
from trexton.flights.frames import Forward
from trexton.flights.importers.axes import axes_option
from trexton.flights.importers.recording import NANO, PoseTrack, Recording, reading, unreadable
from trexton.flights.importers.tracks import pose_track

MOST_BYTES = 3 * MOST_PIXELS  # of a message, and of a piece of the file unpacked
MOST_AHEAD = 0.5  # seconds, of one clock: what a message of one kind travels longer than another
MOST_TIMES = 1000  # the size of the file: more is not unpacked of it on one way through
IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
LEAST_APART, MOST_APART = -NANO // 100, 60 * NANO  # of pieces of one recording
KINDS = (".bag", ".mcap", ".db3")
_ADVICE = "mend it with rosbag reindex, mcap recover or ros2 bag reindex"
# where the place and the attitude of each kind of message are
POSES = {
    "geometry_msgs/msg/PoseStamped": ("pose.position", "pose.orientation"),
    "geometry_msgs/msg/PoseWithCovarianceStamped": ("pose.pose.position", "pose.pose.orientation"),
    "geometry_msgs/msg/TransformStamped": ("transform.translation", "transform.rotation"),
    "nav_msgs/msg/Odometry": ("pose.pose.position", "pose.pose.orientation"),
}
# encoding: type of a channel, channels, and the conversion to BGR (None: already)
_ENCODINGS: dict[str, tuple[str, int, int | None]] = {
    **dict.fromkeys(("bgr8", "8uc3"), ("u1", 3, None)),
    "rgb8": ("u1", 3, cv2.COLOR_RGB2BGR),
    **dict.fromkeys(("mono8", "8uc1"), ("u1", 1, cv2.COLOR_GRAY2BGR)),
    **dict.fromkeys(("bgra8", "8uc4"), ("u1", 4, cv2.COLOR_BGRA2BGR)),
    "rgba8": ("u1", 4, cv2.COLOR_RGBA2BGR),
    **dict.fromkeys(("yuv422", "uyvy"), ("u1", 2, cv2.COLOR_YUV2BGR_UYVY)),
    **dict.fromkeys(("yuv422_yuy2", "yuyv"), ("u1", 2, cv2.COLOR_YUV2BGR_YUY2)),
    "mono16": ("u2", 1, cv2.COLOR_GRAY2BGR),
    "bgr16": ("u2", 3, None),
    "rgb16": ("u2", 3, cv2.COLOR_RGB2BGR),
} | {
    f"bayer_{pattern.lower()}{8 * size}": (f"u{size}", 1, getattr(cv2, f"COLOR_Bayer{pattern}2BGR"))
    for size in (1, 2)
    for pattern in ("RGGB", "BGGR", "GBRG", "GRBG")
}


@dataclass(frozen=True)
class Settings(Options):
    """What can be chosen."""

    image: str = option("", "topic of the images (default: the only one)")
    pose: str = option("", "topic of the positions (default: the only one)")
    body: str = option("", "whose positions, by child_frame_id (default: the only one)")
    axes: str = axes_option()


def recognises(source: Path) -> bool:
    return source.suffix in KINDS or (source / "metadata.yaml").is_file() or bool(_pieces(source))


def read(source: Path, settings: Settings) -> Recording:
    """The recording in a bag; images are read again when they are asked for, in order."""
    bag = _Bag(source)
    images, poses = bag.topic(IMAGES, settings.image), bag.topic(tuple(POSES), settings.pose)
    decoded = partial(_decoded, f"{bag.source}: an image of {images}")
    whole, damaged = [], []
    for number, message in enumerate(bag.messages(images)):
        try:
            whole.append((decoded(message).shape, number, *message[:2]))
        except (FlightError, cv2.error) as error:
            damaged.append(f"message {number + 1}: {error}")
    if len(damaged) > len(whole):
        raise FlightError(damaged[0])
    shapes = Counter(shape for shape, *_ in whole)
    usual = max(shapes, key=shapes.__getitem__, default=())
    sized = [row for shape, *row in whole if shape == usual]
    numbers, *shot = np.array(sized, dtype=np.int64).reshape(-1, 3).T
    every = [(_body(message), stamps, _pose(message)) for *stamps, message in bag.messages(poses)]
    bodies = sorted({body for body, *_ in every})
    wanted = [each for each in bodies if settings.body in ("", each, each.partition(" in ")[0])]
    if every and len(wanted) != 1:  # of several the track would jump to and fro
        found = f"{source}: {poses} holds positions of {', '.join(map(repr, bodies))}"
        raise FlightError(f"{found}: name one of them with --body")
    rows = [row for body, *row in every if body in wanted]
    posed = np.array([stamps for stamps, _ in rows], dtype=np.int64).reshape(-1, 2)
    values = np.array([pose for _, pose in rows], dtype=float).reshape(-1, 7)
    said = [f"images from {images}, positions from {poses}", *unreadable(damaged)]
    if others := len(whole) - len(sized):
        said.append(f"{source}: images of another size than most, left out: {others}")
    stamps = shot[0], posed[:, 0]  # none are where they are zero, or mostly those of others
    clock = int(any(2 * len(np.unique(each[each > 0])) < len(each) for each in stamps))
    if not clock and not all(each.all() for each in stamps):
        shown, known = (each > 0 for each in stamps)
        left = f"{sum(~shown)} images, {sum(~known)} positions"
        said.append(f"{source}: left out, for their headers have no stamp: {left}")
        numbers, shot = numbers[shown], [each[shown] for each in shot]
        posed, values = posed[known], values[known]
    if clock:
        said.append(f"{source}: headers without a stamp: messages are taken at the bag's own times")
    elif len(posed) and len(numbers):
        ahead = float(np.median(shot[0] - shot[1]) - np.median(posed[:, 0] - posed[:, 1])) / NANO
        if abs(ahead) > MOST_AHEAD:
            found = f"by the bag's times headers of images are {ahead:.2f} s ahead of positions'"
            said.append(f"{source}: {found}: two clocks? --offset {ahead:.2f} joins them")
    where, lines = f"{source}, {poses}", range(1, len(posed) + 1)
    placed = PoseTrack(posed[:, clock], values[:, :3])
    track, taken = pose_track(placed, values[:, 3:], settings.axes, where, lines)
    frames = Forward(bag.source, numbers, partial(bag.messages, images), decoded)
    name = f"bag {source.name}: {images}, {poses}"
    return Recording(shot[clock], track, frames, source=name, said=said + taken)


class _Bag:
    """The messages of a bag; every fault of the reader becomes a `FlightError` that names it."""

    def __init__(self, source: Path):
        # ROS 2 keeps its files in a folder that says more of them.
        inside = source.is_file() and (source.parent / "metadata.yaml").is_file()
        self.source = source.parent if inside else source
        with self._open() as reader:
            self.topics = {each.topic: str(each.msgtype) for each in reader.connections}

    def _open(self) -> Any:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore

        with reading(self.source, "bag", _ADVICE):
            _bound_unpacking(self.source)
            _check_tables(self.source)
            paths = _pieces(self.source) or [self.source]
            reader = AnyReader(paths, default_typestore=get_typestore(Stores.ROS2_HUMBLE))
            reader.open()
            for each in reader.readers:
                _check_named_once(each)
            spans = sorted((each.start_time, each.end_time) for each in reader.readers)
            gaps = [start - end for (_, end), (start, _) in pairwise(spans)]
            if gaps and not LEAST_APART < min(gaps) <= max(gaps) < MOST_APART:
                raise ValueError("its files overlap or lie apart, expected pieces of one recording")
        return closing(reader)

    def topic(self, types: tuple[str, ...], wanted: str) -> str:
        fitting = [topic for topic, kind in self.topics.items() if kind in types]
        if wanted and wanted not in fitting or len(fitting) != 1 and not wanted:
            short = " or ".join(kind.rpartition("/")[2] for kind in types)
            found = ", ".join(fitting) or f"none among {', '.join(self.topics) or 'no topics'}"
            raise FlightError(f"{self.source}: topics of {short}: {found}: name one of them")
        return wanted or fitting[0]

    def messages(self, topic: str) -> Iterator[tuple[int, int, Any]]:
        """Stamps of the header and of the bag in nanoseconds, and message."""
        with self._open() as reader:
            chosen = [each for each in reader.connections if each.topic == topic]
            with reading(self.source, "bag", _ADVICE):
                for connection, recorded, data in reader.messages(chosen):
                    if len(data) > MOST_BYTES:
                        raise ValueError(f"a message has {len(data):,} bytes, over {MOST_BYTES:,}")
                    message = reader.deserialize(data, connection.msgtype)
                    stamp = message.header.stamp
                    yield int(stamp.sec) * NANO + int(stamp.nanosec), recorded, message


def _pieces(source: Path) -> list[Path]:
    """The files of a folder that are those of one recording, which was split, and say no more."""
    if not source.is_dir() or (source / "metadata.yaml").is_file():
        return []
    files = sorted(source.iterdir())
    return files if {each.suffix for each in files} in [{kind} for kind in KINDS] else []


def _bound_unpacking(source: Path) -> None:
    """Have the reader unpack no more than `MOST_BYTES` of a piece, and `MOST_TIMES` the file of
    all: kilobytes may hold gigabytes, or name a piece anew for every message."""
    from lz4.frame import LZ4FrameDecompressor

    files = source.rglob("*") if source.is_dir() else [source]
    room = MOST_BYTES + MOST_TIMES * sum(file.stat().st_size for file in files)

    def bounded(kind: Callable[[], Any]) -> Callable[..., bytes]:
        def unpack(data: bytes, size: int = 0) -> bytes:
            nonlocal room
            unpacking = kind()
            whole: bytes = unpacking.decompress(data, max(1, min(room, MOST_BYTES)))
            room -= len(whole)
            if not unpacking.eof:
                raise ValueError("a piece is cut, or would unpack to more than such a file holds")
            return whole

        return unpack

    first, second, mcap = (
        vars(import_module(f"rosbags.{name}"))
        for name in ("rosbag1.reader", "rosbag2.reader", "rosbag2.storage_mcap")
    )
    lz4, zstd = bounded(LZ4FrameDecompressor), bounded(mcap["zstd"].ZstdDecompressor)
    first["decompressors"].update(bz2=bounded(BZ2Decompressor), lz4=lz4)
    mcap["DECOMPRESSORS"].update(lz4=lz4, zstd=zstd)
    second["zstd"] = SimpleNamespace(decompress=zstd, open=_refuse_file)


def _check_tables(source: Path) -> None:
    """Refuse a database whose messages are computed as they are read, which may never end, or so
    large that reading one would fill the memory.
    """
    for file in source.glob("*.db3") if source.is_dir() else [source] * (source.suffix == ".db3"):
        address = f"{file.resolve().as_uri()}?mode=ro&immutable=1"
        with closing(sqlite3.connect(address, uri=True)) as base:
            for name, made in base.execute("SELECT name, sql FROM sqlite_master"):
                if re.search(r"\bas\b", made or "", re.IGNORECASE):
                    raise ValueError(f"its {name!r} is computed: expected stored messages")
            (largest,) = base.execute("SELECT max(length(data)) FROM messages").fetchone()
            if (largest or 0) > MOST_BYTES:
                raise ValueError(f"a message of {largest:,} bytes: expected up to {MOST_BYTES:,}")


def _check_named_once(reader: Any) -> None:
    """Refuse a bag that names a file, a piece or a message twice: it would come as often."""
    storage = getattr(reader, "storage", None)
    files = getattr(storage, "storages", [storage])
    named: list[Any] = [getattr(file, "path", None) for file in files]
    for index in getattr(reader, "indexes", {}).values():  # of a bag of ROS 1
        named += map(tuple, index)
    twice = len(set(named)) < len(named)
    for file in files:
        span = attrgetter("chunk_start_offset", "compressed_size")
        pieces = sorted(map(span, getattr(file, "chunks", ())))
        twice |= any(start + size > then for (start, size), (then, _) in pairwise(pieces))
    if twice:
        raise ValueError("its index names a file, a piece or a message twice")


def _refuse_file(*_: Any) -> NoReturn:
    raise ValueError("packed as a whole file: convert it to MCAP with ros2 bag convert")


def _body(message: Any) -> str:
    """Whose pose it is, in which frame."""
    named = getattr(message, "child_frame_id", ""), message.header.frame_id
    return " in ".join(filter(None, named))


def _pose(message: Any) -> list[float]:
    """x, y, z and the quaternion x, y, z, w."""
    place, turn = attrgetter(*POSES[message.__msgtype__])(message)
    return [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]


def _decoded(where: str, message: tuple[int, int, Any]) -> np.ndarray:
    """``(H, W, 3) uint8`` BGR of a message of an image."""
    *_, item = message
    if hasattr(item, "format"):
        image = decode(data := bytes(item.data))  # refuses what declares too much
        if image is None or (found := damage(data)):
            why = item.format if image is None else found
            raise FlightError(f"{where} cannot be decoded ({why})")
        packed, _, how = item.format.lower().partition(";")
        mosaic = _ENCODINGS[packed][2] if packed in _ENCODINGS and "bayer" in packed else None
        if mosaic is not None and "bgr" not in how:  # as the sensor has it
            return cv2.cvtColor(image[..., :1].copy(), mosaic)
        return image
    if item.encoding.lower() not in _ENCODINGS:
        raise FlightError(f"{where} is in {item.encoding!r}: expected {', '.join(_ENCODINGS)}")
    kind, channels, conversion = _ENCODINGS[item.encoding.lower()]
    kind = (">" if item.is_bigendian else "<") + kind
    rows, columns, step = int(item.height), int(item.width), int(item.step)
    if rows * columns > MOST_PIXELS:
        raise FlightError(f"{where} has {columns}x{rows} pixels: expected at most {MOST_PIXELS:,}")
    width = columns * channels * np.dtype(kind).itemsize
    if len(item.data) < rows * step or step < width:
        raise FlightError(f"{where} is shorter than its {columns}x{rows} pixels")
    lines = np.asarray(item.data, np.uint8)[: rows * step].reshape(rows, step)
    pixels = np.ascontiguousarray(lines[:, :width]).view(kind).reshape(rows, columns, channels)
    if pixels.dtype.itemsize == 2:
        pixels = (pixels // 257).astype(np.uint8)
    return pixels if conversion is None else cv2.cvtColor(pixels, conversion)
