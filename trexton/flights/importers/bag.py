"""ROS 1 and ROS 2 bags: an image topic, and one of poses or odometry."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from trexton.base.errors import FlightError
from trexton.base.options import Options, option
from trexton.flights.frames import Forward
from trexton.flights.importers.axes import axes_option
from trexton.flights.importers.recording import NANO, Recording
from trexton.flights.importers.tracks import pose_track
from trexton.vision.images import decode

__all__ = ["Settings", "read", "recognises"]

IMAGES = ("sensor_msgs/msg/Image", "sensor_msgs/msg/CompressedImage")
# where the pose of each kind of message is
POSES = {
    "geometry_msgs/msg/PoseStamped": "pose",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose.pose",
    "geometry_msgs/msg/TransformStamped": "transform",
    "nav_msgs/msg/Odometry": "pose.pose",
}
# encoding: type of a channel, channels, and the conversion to BGR (None: already). OpenCV names a
# Bayer pattern by its second row's second pixel, ROS by its first.
_ENCODINGS: dict[str, tuple[str, int, int | None]] = {
    "bgr8": ("u1", 3, None),
    "rgb8": ("u1", 3, cv2.COLOR_RGB2BGR),
    "mono8": ("u1", 1, cv2.COLOR_GRAY2BGR),
    "bgra8": ("u1", 4, cv2.COLOR_BGRA2BGR),
    "rgba8": ("u1", 4, cv2.COLOR_RGBA2BGR),
    "yuv422": ("u1", 2, cv2.COLOR_YUV2BGR_UYVY),
    "uyvy": ("u1", 2, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": ("u1", 2, cv2.COLOR_YUV2BGR_YUY2),
    "yuyv": ("u1", 2, cv2.COLOR_YUV2BGR_YUY2),
    "8uc1": ("u1", 1, cv2.COLOR_GRAY2BGR),
    "8uc3": ("u1", 3, None),
    "8uc4": ("u1", 4, cv2.COLOR_BGRA2BGR),
    "mono16": ("u2", 1, cv2.COLOR_GRAY2BGR),
    "bgr16": ("u2", 3, None),
    "rgb16": ("u2", 3, cv2.COLOR_RGB2BGR),
} | {
    f"bayer_{pattern}{8 * size}": (f"u{size}", 1, code)
    for size in (1, 2)
    for pattern, code in (
        ("rggb", cv2.COLOR_BayerBG2BGR),
        ("bggr", cv2.COLOR_BayerRG2BGR),
        ("gbrg", cv2.COLOR_BayerGR2BGR),
        ("grbg", cv2.COLOR_BayerGB2BGR),
    )
}


@dataclass(frozen=True)
class Settings(Options):
    """What can be chosen."""

    image: str = option("", "topic of the images (default: the only one)")
    pose: str = option("", "topic of the positions (default: the only one)")
    axes: str = axes_option()


def recognises(source: Path) -> bool:
    return source.suffix in (".bag", ".mcap", ".db3") or (source / "metadata.yaml").is_file()


def read(source: Path, settings: Settings) -> Recording:
    """The recording in a bag; images are read again when they are asked for, in order."""
    bag = _Bag(source)
    images, poses = bag.topic(IMAGES, settings.image), bag.topic(tuple(POSES), settings.pose)
    shot = np.array([stamps for *stamps, _ in bag.messages(images)], dtype=np.int64).reshape(-1, 2)
    rows = [(*stamps, _pose(message)) for *stamps, message in bag.messages(poses)]
    told = np.array([stamps for *stamps, _ in rows], dtype=np.int64).reshape(-1, 2)
    values = np.array([pose for *_, pose in rows], dtype=float).reshape(-1, 7)
    said = [f"images from {images}, positions from {poses}"]
    clock = int((shot[:, 0] == 0).any() or (told[:, 0] == 0).any())
    if clock:
        said.append(f"{source}: headers without a stamp: messages are taken at the bag's own times")
    lines = range(1, len(rows) + 1)
    track, taken = pose_track(
        told[:, clock], values[:, :3], values[:, 3:], settings.axes, f"{source}, {poses}", lines
    )
    return Recording(
        shot[:, clock],
        track,
        BagFrames(bag, images, len(shot)),
        source=f"bag {source.name}: {images}, {poses}",
        said=said + taken,
    )


class _Bag:
    """The messages of a bag; every fault of the reader becomes a `FlightError` that names it."""

    def __init__(self, source: Path):
        # ROS 2 keeps its files in a folder that says more of them.
        inside = source.is_file() and (source.parent / "metadata.yaml").is_file()
        self.source = source.parent if inside else source
        with self._open() as reader:
            self.topics = {each.topic: str(each.msgtype) for each in reader.connections}

    def _open(self) -> Any:
        from rosbags.highlevel import AnyReader, AnyReaderError
        from rosbags.typesys import Stores, get_typestore

        try:
            reader = AnyReader([self.source], default_typestore=get_typestore(Stores.ROS2_HUMBLE))
            reader.open()
        except (AnyReaderError, OSError, ValueError, KeyError, MemoryError) as error:
            raise FlightError(
                f"{self.source}: not a readable bag ({error}): record it again"
            ) from None
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
            for connection, recorded, data in reader.messages(chosen):
                try:
                    message = reader.deserialize(data, connection.msgtype)
                except Exception as error:  # whatever a damaged message raises
                    raise FlightError(
                        f"{self.source}: a message of {topic} is damaged ({error}): record it again"
                    ) from None
                stamp = message.header.stamp
                yield int(stamp.sec) * NANO + int(stamp.nanosec), recorded, message


def _pose(message: Any) -> list[float]:
    """x, y, z and the quaternion x, y, z, w."""
    pose = message
    for name in POSES[message.__msgtype__].split("."):
        pose = getattr(pose, name)
    if hasattr(pose, "translation"):
        place, turn = pose.translation, pose.rotation
    else:
        place, turn = pose.position, pose.orientation
    return [place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w]


class BagFrames(Forward):
    """The images of one topic."""

    def __init__(self, bag: _Bag, topic: str, count: int):
        super().__init__(bag.source, count)
        self._bag, self._topic = bag, topic

    def items(self) -> Iterator[Any]:
        return (message for *_, message in self._bag.messages(self._topic))

    def decoded(self, item: Any) -> np.ndarray:
        where = f"{self._bag.source}: an image of {self._topic}"
        if hasattr(item, "format"):
            image = decode(bytes(item.data))
            if image is None:
                raise FlightError(f"{where} cannot be decoded (format {item.format!r})")
            return image
        if item.encoding.lower() not in _ENCODINGS:
            known = ", ".join(_ENCODINGS)
            raise FlightError(f"{where} is encoded as {item.encoding!r}: expected {known}")
        kind, channels, conversion = _ENCODINGS[item.encoding.lower()]
        kind = (">" if item.is_bigendian else "<") + kind
        rows, columns, step = int(item.height), int(item.width), int(item.step)
        width = columns * channels * np.dtype(kind).itemsize
        if len(item.data) < rows * step or step < width:
            raise FlightError(f"{where} is shorter than its {columns}x{rows} pixels")
        lines = np.asarray(item.data, np.uint8)[: rows * step].reshape(rows, step)
        pixels = np.ascontiguousarray(lines[:, :width]).view(kind).reshape(rows, columns, channels)
        if pixels.dtype.itemsize == 2:
            pixels = (pixels // 257).astype(np.uint8)
        return pixels if conversion is None else cv2.cvtColor(pixels, conversion)
