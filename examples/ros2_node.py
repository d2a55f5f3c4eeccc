"""Positions of ``trexton onboard`` as a ROS 2 topic: PoseWithCovarianceStamped in ENU.

    trexton onboard hall.npz | python3 ros2_node.py --heading 84

ROS's own words may follow, as in --ros-args -r position:=/vision/pose. It reads a --log too.

`pose` is the whole conversion and needs no ROS; `main` needs rclpy and geometry_msgs. Stamps are
those of the capture, on ROS's clock.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
import time

UNKNOWN = 1e6  # a variance that makes a number weightless


def pose(row: dict, heading: float) -> dict | None:
    """Position and 6x6 covariance of one JSON line; None for what no vehicle may steer by, and for
    the events of a log.

    `heading` is that of the map's +y axis in radians from north, clockwise. East and north are map
    x and y, turned clockwise by it.
    """
    if "event" in row:
        return None
    if not row["observed"] or row["lost"] or row["stale"] or None in row["measurement_m"]:
        return None
    (x, y), (xx, xy, yy) = row["measurement_m"], row["measurement_covariance_m2"]
    c, s = math.cos(heading), math.sin(heading)
    covariance = [0.0] * 36
    covariance[0] = c * c * xx + 2 * c * s * xy + s * s * yy
    covariance[1] = covariance[6] = -c * s * xx + (c * c - s * s) * xy + c * s * yy
    covariance[7] = s * s * xx - 2 * c * s * xy + c * c * yy
    for place in (14, 21, 28, 35):
        covariance[place] = UNKNOWN
    return {
        "time_s": row["time_s"],
        "position": (c * x + s * y, c * y - s * x, 0.0),
        "covariance": covariance,
    }


def age(row: dict) -> float:
    """Seconds since the capture: `time_s` is of the steady clock that all programs of a computer
    share. A recording has another clock, of which the latency alone is known."""
    passed = time.monotonic() - row["time_s"]
    return passed if 0 <= passed < 60 else row["latency_s"]


def main() -> None:
    import rclpy
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from rclpy.duration import Duration
    from rclpy.utilities import remove_ros_args

    parser = argparse.ArgumentParser()
    parser.add_argument("--heading", type=float, default=0.0, help="degrees")
    parser.add_argument("--frame", default="map")
    arguments = parser.parse_args(remove_ros_args(sys.argv)[1:])
    rclpy.init()
    node = rclpy.create_node("trexton")
    publisher = node.create_publisher(PoseWithCovarianceStamped, "position", 10)
    for line in sys.stdin:
        row = json.loads(line)
        found = pose(row, math.radians(arguments.heading))
        if found is None:
            continue
        captured = node.get_clock().now() - Duration(nanoseconds=round(1e9 * age(row)))
        message = PoseWithCovarianceStamped()
        message.header.frame_id = arguments.frame
        message.header.stamp = captured.to_msg()
        place = message.pose.pose.position
        place.x, place.y, place.z = found["position"]
        message.pose.pose.orientation.w = 1.0
        message.pose.covariance = found["covariance"]
        publisher.publish(message)


if __name__ == "__main__":
    main()
