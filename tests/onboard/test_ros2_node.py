"""The node for ROS 2 in `examples`: its messages, and its life, with stand-ins for ROS."""

from __future__ import annotations

import json
import os
import runpy
import signal
import subprocess
import sys
import time
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from conftest import ROOT
from onboard_tools import make_fix
from patience import eventually

from trexton.onboard.fix import LocalFrame
from trexton.onboard.sinks.files import row

EXAMPLE = str(ROOT / "examples" / "ros2_node.py")


def test_the_pose_for_ros_is_that_of_the_autopilots_axes(rng):
    pose = runpy.run_path(EXAMPLE)["pose"]
    for heading in (0.0, 0.7, -2.0):
        half = rng.normal(size=(2, 2))
        fix = make_fix(1.0, rng.normal(size=2), half @ half.T, heading=0.4, heading_sigma=0.02)
        found = pose(json.loads(json.dumps(row(fix))), heading)
        local = LocalFrame(heading)
        np.testing.assert_allclose(found["position"][:2], local.enu(fix.position)[:2])
        ned = local.ned_covariance(fix.covariance)
        covariance = np.reshape(found["covariance"], (6, 6))
        np.testing.assert_allclose(covariance[:2, :2], ned[::-1, ::-1])
        # From east anticlockwise to the nose, whose compass heading is `LocalFrame.yaw`.
        sine, cosine = found["orientation"]
        nose = np.array([cosine**2 - sine**2, 2 * sine * cosine])
        yaw = local.yaw(0.4)
        np.testing.assert_allclose(nose, [np.sin(yaw), np.cos(yaw)], atol=1e-12)
        assert covariance[5, 5] == pytest.approx(4e-4)
    assert pose(row(make_fix(1.0, lost=True)), 0.0) is None
    unknown = pose(row(make_fix(1.0)), 0.0)
    assert unknown["orientation"] == (0.0, 1.0) and unknown["covariance"][35] == 1e6


def test_the_age_for_ros_is_that_of_the_capture():
    """Stamped when it was published, a position was as late as camera and computer together."""
    age = runpy.run_path(EXAMPLE)["age"]
    live = row(make_fix(time.monotonic() - 0.2, latency=0.15))
    assert age(live) == pytest.approx(0.2, abs=0.05)
    assert age(row(make_fix(1e12, latency=0.15))) == 0.15  # a recording's clock


class Time(float):
    """Seconds, as ROS's clock gives them."""

    def __sub__(self, other):
        return Time(float(self) - other.nanoseconds * 1e-9)

    def to_msg(self):
        return float(self)


class Message(SimpleNamespace):
    """Any message: fields are made when they are asked for."""

    OK, WARN, ERROR = b"\0", b"\1", b"\2"

    def __getattr__(self, name):
        if name.startswith("__"):
            raise AttributeError(name)
        setattr(self, name, Message())
        return getattr(self, name)


class Publisher(list):
    """Keeps what is published while its node is active."""

    publish = list.append


class LifecycleNode:
    """What the node uses of `rclpy.lifecycle.Node`."""

    given: dict = {}
    made: list = []

    def __init__(self, name):
        self.parameters, self.topics, self.states, self.destroyed = {}, {}, [], []
        self.made.append(self)

    def declare_parameter(self, name, default, descriptor):
        assert descriptor.dynamic_typing
        self.parameters[name] = self.given.get(name, default)

    def get_parameter(self, name):
        return SimpleNamespace(value=self.parameters[name])

    def create_publisher(self, kind, topic, depth):
        return self.topics.setdefault(topic, Publisher())

    create_lifecycle_publisher = create_publisher

    def create_timer(self, period, callback):
        return callback

    def get_logger(self):
        return SimpleNamespace(error=self.states.append)

    def get_clock(self):
        return SimpleNamespace(now=lambda: Time(1000.0))

    def trigger_configure(self):
        assert self.on_configure(None) == "success"

    def trigger_activate(self):
        assert self.on_activate(None) == "success"

    def on_activate(self, state):
        self.states.append("active")
        return "success"

    def on_deactivate(self, state):
        self.states.append("inactive")
        return "success"

    def destroy_timer(self, each):
        self.destroyed.append(each)

    destroy_publisher = destroy_timer

    def destroy_node(self):
        self.states.append("destroyed")


def put_in(monkeypatch, modules: dict[str, dict]) -> None:
    """Modules of these names and contents, to be imported."""
    for name, contents in modules.items():
        module = ModuleType(name)
        vars(module).update(contents)
        monkeypatch.setitem(sys.modules, name, module)


@pytest.fixture
def ros(monkeypatch):
    """Stand-ins for the packages of ROS that the node imports; gives the node's class."""
    kinds = {
        "rclpy": {"init": lambda: None, "spin": lambda node: node.reader.join(20),
                  "try_shutdown": lambda: None},
        "rclpy.duration": {"Duration": SimpleNamespace},
        "rclpy.executors": {"ExternalShutdownException": InterruptedError},
        "rclpy.lifecycle": {"Node": LifecycleNode,
                            "TransitionCallbackReturn": SimpleNamespace(SUCCESS="success",
                                                                        FAILURE="failure")},
        "rcl_interfaces": {}, "rcl_interfaces.msg": {"ParameterDescriptor": SimpleNamespace},
        "geometry_msgs": {}, "diagnostic_msgs": {},
        "geometry_msgs.msg": {"PoseWithCovarianceStamped": Message},
        "diagnostic_msgs.msg": dict.fromkeys(
            ("DiagnosticArray", "DiagnosticStatus", "KeyValue"), Message
        ),
    }  # fmt: skip
    put_in(monkeypatch, kinds)
    monkeypatch.setattr(LifecycleNode, "given", {})
    monkeypatch.setattr(LifecycleNode, "made", [])
    return LifecycleNode


def written(path, *lines):
    path.write_text("".join(json.dumps(line) + "\n" for line in lines))
    return path


def test_a_log_on_standard_input_becomes_stamped_positions(ros, tmp_path, monkeypatch):
    now = time.monotonic()
    lines = [row(make_fix(now - 0.5, (1.0, 2.0))), {"event": "status"}]
    lines += [row(make_fix(now, lost=True)), row(make_fix(1e9, (3.0, 4.0), latency=0.25))]
    log = written(tmp_path / "log", *lines)
    log.write_text('{"time_s": 3\n' + log.read_text())  # a line that was cut off
    monkeypatch.setattr(sys, "stdin", log.open())
    ros.given = {"heading": 90.0, "frame_id": "hall"}
    runpy.run_path(EXAMPLE, run_name="__main__")
    (node,) = ros.made
    first, second = node.topics["position"]
    place = first.pose.pose.position
    assert (place.x, place.y) == pytest.approx((2.0, -1.0)) and first.header.frame_id == "hall"
    assert first.header.stamp == pytest.approx(1000 - 0.5, abs=0.3)
    assert second.header.stamp == pytest.approx(1000 - 0.25)
    assert node.states == ["active", "destroyed"]


def test_a_command_is_run_while_the_node_is_active_and_diagnosed(ros, tmp_path):
    log = written(tmp_path / "log", row(make_fix(1.0)), row(make_fix(2.0, lost=True)))
    ros.given = {"command": ["sh", "-c", f"cat {log}; exec sleep 60"]}
    node = runpy.run_path(EXAMPLE)["PositionNode"]()
    node.trigger_configure()

    def diagnosed():
        node.diagnose()
        (status,) = node.topics["/diagnostics"][-1].status
        return status.level, status.message

    assert diagnosed() == (b"\2", "no positions come")
    node.trigger_activate()
    assert eventually(lambda: node.count == 2)
    assert diagnosed() == (b"\1", "lost")
    node.row = row(make_fix(3.0))
    assert diagnosed() == (b"\0", "positions come")
    process = node.process
    node.heard_at -= 2.0
    assert diagnosed()[0] == b"\2"
    assert os.getsid(process.pid) == process.pid  # Ctrl-C in a terminal is not for it
    node.on_deactivate(None)
    assert process.returncode is not None and node.states == ["active", "inactive"]
    assert node.on_cleanup(None) == node.on_shutdown(None) == "success" and len(node.destroyed) == 3


def test_a_command_that_cannot_be_run_is_said(ros):
    ros.given = {"command": ["/nowhere/trexton"]}
    node = runpy.run_path(EXAMPLE)["PositionNode"]()
    node.trigger_configure()
    assert node.on_activate(None) == "failure" and "/nowhere/trexton" in node.states[-1]
    node.end()


def test_a_command_that_does_not_end_is_killed(ros, monkeypatch):
    ros.given = {"command": ["sh", "-c", "trap '' TERM; echo {}; while :; do sleep 1; done"]}
    node = runpy.run_path(EXAMPLE)["PositionNode"]()
    monkeypatch.setattr(node, "read", lambda stream: setattr(node, "row", stream.readline()))
    node.trigger_configure()
    node.trigger_activate()
    assert eventually(lambda: node.row)
    process = node.process
    wait = process.wait
    monkeypatch.setattr(process, "wait", lambda seconds: wait(0.1))
    node.end()
    assert wait(10) == -signal.SIGKILL


def test_standard_input_has_one_reader_however_often_the_node_is_activated(ros, monkeypatch):
    """Two threads took lines from one another."""
    down, up = os.pipe()
    monkeypatch.setattr(sys, "stdin", os.fdopen(down))
    node = runpy.run_path(EXAMPLE)["PositionNode"]()
    node.trigger_configure()
    node.trigger_activate()
    reader = node.reader
    node.on_deactivate(None)
    node.trigger_activate()
    assert node.reader is reader
    os.write(up, json.dumps(row(make_fix(1.0))).encode() + b"\n")
    assert eventually(lambda: node.count == 1)
    os.close(up)


def test_the_launch_file_gives_each_argument_to_node_or_program(monkeypatch):
    made = {}

    def process(cmd, output):
        made["words"] = ["".join(word) if isinstance(word, list) else word for word in cmd]

    stand_ins = {
        "launch": {"LaunchDescription": list},
        "launch.actions": {"DeclareLaunchArgument": lambda name, default_value: name,
                           "ExecuteProcess": process},
        "launch.substitutions": {"LaunchConfiguration": lambda name: f"<{name}>"},
    }  # fmt: skip
    put_in(monkeypatch, stand_ins)
    launch = runpy.run_path(str(ROOT / "examples" / "ros2_launch.py"))
    assert launch["generate_launch_description"]()[:4] == list(launch["ARGUMENTS"])
    assert made["words"][1] == EXAMPLE
    assert made["words"][3:] == [
        "-p", "heading:=<heading>", "-p", "frame_id:=<frame_id>",
        "-p", "command:=['trexton', 'onboard', '<map>', '--camera', '<camera>']",
    ]  # fmt: skip


LISTENER = """
import json, sys, time
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from lifecycle_msgs.srv import ChangeState

rclpy.init()
node, places, levels = rclpy.create_node("listener"), [], []

def place(message):
    stamp, point = message.header.stamp, message.pose.pose.position
    age = time.time() - stamp.sec - 1e-9 * stamp.nanosec
    places.append((point.x, point.y, message.pose.covariance[0], message.header.frame_id, age))

node.create_subscription(PoseWithCovarianceStamped, "position", place, 10)
node.create_subscription(
    DiagnosticArray, "/diagnostics", lambda message: levels.append(ord(message.status[0].level)), 10
)
changes = node.create_client(ChangeState, "/trexton/change_state")

def until(true):
    end = time.monotonic() + 60
    while not true() and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    assert true()

until(lambda: len(places) > 5 and 0 in levels)
for transition in (4, 3):  # deactivate, activate
    request = ChangeState.Request()
    request.transition.id = transition
    answer = changes.call_async(request)
    until(answer.done)
    assert answer.result().success
    places.clear()
    if transition == 4:
        until(lambda: levels[-1] == 2)
        assert not places
until(lambda: len(places) > 5)
print(json.dumps(places[-1]))
"""
FEED = """
import json, time
row = json.loads(ROW)
while True:
    print(json.dumps(row | {"time_s": time.monotonic() - 0.25}), flush=True)
    time.sleep(0.1)
"""


@pytest.mark.slow
@pytest.mark.skipif("TREXTON_ROS_PYTHON" not in os.environ, reason="names a Python with rclpy")
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_the_real_rclpy(tmp_path, ending):
    """Without a robot: ``pip install 'ros-rclpy[fastrtps]' ros-geometry-msgs ros-diagnostic-msgs``
    in an environment of its own, and TREXTON_ROS_PYTHON=THAT/bin/python make test-slow."""
    python = os.environ["TREXTON_ROS_PYTHON"]
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    environment |= {"ROS_LOG_DIR": str(tmp_path), "ROS_DOMAIN_ID": str(os.getpid() % 100)}
    line = json.dumps(row(make_fix(1.0, (1.0, 2.0))))
    (tmp_path / "feed.py").write_text(FEED.replace("ROW", repr(line)))
    command = f"command:=['{python}', '{tmp_path}/feed.py']"
    words = ["--ros-args", "-p", "heading:=90.0", "-p", "frame_id:=hall", "-p", command]
    node = subprocess.Popen(
        [python, EXAMPLE, *words], env=environment, stderr=subprocess.PIPE, text=True
    )
    try:
        heard = subprocess.run(
            [python, "-c", LISTENER], env=environment, capture_output=True, text=True, timeout=180
        )
        assert heard.returncode == 0, heard.stderr
        node.send_signal(ending)
        _, errors = node.communicate(timeout=60)
    finally:
        node.kill()
    assert node.returncode == 0 and "Traceback" not in errors
    x, y, variance, frame, age = json.loads(heard.stdout)
    assert x == pytest.approx(2.0) and y == pytest.approx(-1.0) and frame == "hall"
    assert variance == pytest.approx(0.09) and age == pytest.approx(0.25, abs=0.2)
