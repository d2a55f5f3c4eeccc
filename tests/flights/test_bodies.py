"""Bags whose transforms are of several bodies, or in several frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from trexton.base.errors import FlightError
from trexton.flights.importing import import_flight

N = 10**9
KIND = "geometry_msgs/msg/TransformStamped"


def transforms(path: Path, *bodies: tuple[str, str, float]) -> Path:
    """Twelve images, and for each body (frame, child frame, metres aside) its transforms."""
    store = get_typestore(Stores.ROS1_NOETIC)
    kinds = store.types
    with Writer(path) as writer:
        images = writer.add_connection("/image", "sensor_msgs/msg/Image", typestore=store)
        poses = writer.add_connection("/vicon", KIND, typestore=store)
        for row in range(12):
            now = 1_700_000_000 * N + row * N // 20

            def header(frame, now=now):
                stamp = kinds["builtin_interfaces/msg/Time"](sec=now // N, nanosec=now % N)
                return kinds["std_msgs/msg/Header"](seq=0, stamp=stamp, frame_id=frame)

            for frame, child, aside in bodies:
                at = kinds["geometry_msgs/msg/Vector3"](x=row / 5 + aside, y=1.0, z=1.0)
                turn = kinds["geometry_msgs/msg/Quaternion"](x=1.0, y=0.0, z=0.0, w=0.0)
                placed = kinds["geometry_msgs/msg/Transform"](translation=at, rotation=turn)
                message = kinds[KIND](header(frame), child, placed)
                writer.write(poses, now, store.serialize_ros1(message, KIND))
            message = kinds["sensor_msgs/msg/Image"](
                header("camera"), 6, 8, "mono8", 0, 8, np.full(48, 10 * row, np.uint8)
            )
            writer.write(images, now, store.serialize_ros1(message, "sensor_msgs/msg/Image"))
    return path


def test_the_only_body_needs_no_name(tmp_path):
    flight, _ = import_flight(transforms(tmp_path / "b.bag", ("world", "drone", 0)), tmp_path / "f")
    np.testing.assert_allclose(flight.position[:, 0], np.arange(12) / 5)


@pytest.mark.parametrize(
    "other, name",
    [(("world", "wand", 3.0), "wand"), (("odom", "drone", 3.0), "drone in odom")],
)
def test_several_are_refused_until_one_is_named(tmp_path, other, name):
    source = transforms(tmp_path / "b.bag", ("world", "drone", 0), other)
    with pytest.raises(FlightError, match=f"holds positions of .*{name}.*name one .* --body"):
        import_flight(source, tmp_path / "f")
    assert not (tmp_path / "f").exists()
    with pytest.raises(FlightError, match="holds positions of"):
        import_flight(source, tmp_path / "f", settings={"body": "nobody"})
    flight, _ = import_flight(source, tmp_path / "f", settings={"body": name})
    np.testing.assert_allclose(flight.position[:, 0], np.arange(12) / 5 + 3)
