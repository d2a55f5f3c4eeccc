"""Positions of ``trexton onboard`` in ROS 2: PoseWithCovarianceStamped in ENU, and /diagnostics.

    trexton onboard hall.npz | python3 ros2_node.py --ros-args -p heading:=84.0

A lifecycle node. It configures and activates itself unless `autostart` is false, and reads a
``--log`` as well. `ros2_launch.py` starts it with a command of its own to read from.
Stamps are those of the capture, on ROS's clock. `pose` and `age` need no ROS.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import threading
import time

try:
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from rcl_interfaces.msg import ParameterDescriptor
    from rclpy.duration import Duration
    from rclpy.executors import ExternalShutdownException
    from rclpy.lifecycle import Node, TransitionCallbackReturn
except ImportError:
    Node = object

UNKNOWN = 1e6  # a variance that makes a number weightless
SILENT_S = 1.0  # without a line, after which something is wrong
PARAMETERS = {
    "heading": 0.0,  # compass heading of the map's +y axis, degrees
    "frame_id": "map",
    "command": [""],  # that writes the lines; standard input unless given
    "autostart": True,
}


def pose(row: dict, heading: float) -> dict | None:
    """Position, orientation (z and w of the quaternion) and 6x6 covariance of one JSON line; None
    for what no vehicle may steer by, and for the events of a log.

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
    turn = 0.0
    if row.get("heading_rad") is not None:  # a weightless zero where it is not known
        turn = math.pi / 2 - heading + row["heading_rad"]
        covariance[35] = row["heading_std_rad"] ** 2
    return {
        "position": (c * x + s * y, c * y - s * x, 0.0),
        "orientation": (math.sin(turn / 2), math.cos(turn / 2)),
        "covariance": covariance,
    }


def age(row: dict) -> float:
    """Seconds since the capture: `time_s` is of the steady clock that all programs of a computer
    share. A recording has another clock, of which the latency alone is known."""
    passed = time.monotonic() - row["time_s"]
    return passed if 0 <= passed < 60 else row["latency_s"]


class PositionNode(Node):
    """Publishes `position` while it is active, and how things stand once a second."""

    def __init__(self):
        super().__init__("trexton")
        for name, default in PARAMETERS.items():
            # Else `heading:=84` is refused, for want of a point.
            self.declare_parameter(name, default, ParameterDescriptor(dynamic_typing=True))
        self.process = self.reader = None
        self.row, self.heard_at, self.count = None, -math.inf, 0

    def value(self, name):
        return self.get_parameter(name).value

    def on_configure(self, state):
        self.publisher = self.create_lifecycle_publisher(PoseWithCovarianceStamped, "position", 10)
        self.diagnostics = self.create_publisher(DiagnosticArray, "/diagnostics", 10)
        self.timer = self.create_timer(1.0, self.diagnose)
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state):
        stream, command = sys.stdin, [word for word in self.value("command") if word]
        if command:
            # In a session of its own: Ctrl-C is for this node, whose `end` then ends the program
            # once. A second signal would cut it off.
            try:
                self.process = subprocess.Popen(
                    command, stdout=subprocess.PIPE, text=True, start_new_session=True
                )
            except OSError as error:
                self.get_logger().error(f"the command cannot be run: {error}")
                return TransitionCallbackReturn.FAILURE
            stream = self.process.stdout
        if command or self.reader is None:  # of standard input there is one reader, for good
            self.reader = threading.Thread(target=self.read, args=(stream,), daemon=True)
            self.reader.start()
        return super().on_activate(state)

    def on_deactivate(self, state):
        self.end()
        return super().on_deactivate(state)

    def on_cleanup(self, state):
        self.destroy_timer(self.timer)
        for publisher in (self.publisher, self.diagnostics):
            self.destroy_publisher(publisher)
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state):
        self.end()
        return TransitionCallbackReturn.SUCCESS

    def end(self):
        """End the program that is read from; it closes its log first."""
        if self.process is not None:
            self.process.terminate()
            try:
                self.process.wait(10)
            except subprocess.TimeoutExpired:
                self.process.kill()
            self.process = None

    def read(self, stream):
        for line in stream:
            try:
                row = json.loads(line)
            except ValueError:  # half a line, of a program that was cut off
                continue
            if "event" not in row:
                self.row, self.heard_at, self.count = row, time.monotonic(), self.count + 1
            found = pose(row, math.radians(self.value("heading")))
            if found is not None:
                self.publisher.publish(self.message(row, found))

    def message(self, row, found):
        message = PoseWithCovarianceStamped()
        message.header.frame_id = self.value("frame_id")
        captured = self.get_clock().now() - Duration(nanoseconds=round(1e9 * age(row)))
        message.header.stamp = captured.to_msg()
        place, turn = message.pose.pose.position, message.pose.pose.orientation
        place.x, place.y, place.z = found["position"]
        turn.z, turn.w = found["orientation"]
        message.pose.covariance = found["covariance"]
        return message

    def diagnose(self):
        """Ready to steer by, lost, or silent."""
        row, status = self.row, DiagnosticStatus(name="trexton: position", hardware_id="camera")
        if row is None or time.monotonic() - self.heard_at > SILENT_S:
            status.level, status.message = DiagnosticStatus.ERROR, "no positions come"
        elif row["lost"] or row["stale"] or not row["observed"]:
            status.level, status.message = DiagnosticStatus.WARN, row["fault"] or "lost"
        else:
            status.level, status.message = DiagnosticStatus.OK, "positions come"
        said = {"frames": self.count}
        if row is not None:
            said |= {key: row[key] for key in ("lost", "stale", "resets", "latency_s", "fault")}
        status.values = [KeyValue(key=key, value=str(value)) for key, value in said.items()]
        message = DiagnosticArray(status=[status])
        message.header.stamp = self.get_clock().now().to_msg()
        self.diagnostics.publish(message)


def main() -> None:
    rclpy.init()
    node = PositionNode()
    if node.value("autostart"):
        node.trigger_configure()
        node.trigger_activate()
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.end()
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
