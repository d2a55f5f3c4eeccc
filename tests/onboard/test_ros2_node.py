"""The node for ROS 2 in `examples`: its messages, and its life, with stand-ins for ROS."""

from __future__ import annotations

import json
import runpy
import sys
import time
from unittest.mock import MagicMock

import numpy as np
import pytest
from conftest import ROOT
from onboard_tools import make_fix

from trexton.onboard.local import LocalFrame
from trexton.onboard.sinks.files import row

EXAMPLE = ROOT / "examples" / "ros2_node.py"


@pytest.fixture
def log(tmp_path):
    lines = [row(make_fix(1.0)), {"event": "status"}, row(make_fix(2.0, lost=True))]
    lines += [row(make_fix(3.0))]
    (tmp_path / "log").write_text("".join(json.dumps(line) + "\n" for line in lines))
    return tmp_path / "log"


def test_the_pose_for_ros_is_that_of_the_autopilots_axes(rng):
    pose = runpy.run_path(str(EXAMPLE))["pose"]
    for heading in (0.0, 0.7, -2.0):
        half = rng.normal(size=(2, 2))
        fix = make_fix(1.0, rng.normal(size=2), half @ half.T)
        found = pose(json.loads(json.dumps(row(fix))), heading)
        local = LocalFrame(heading)
        np.testing.assert_allclose(found["position"][:2], local.enu(fix.position)[:2])
        ned = local.ned_covariance(fix.covariance)
        covariance = np.reshape(found["covariance"], (6, 6))
        np.testing.assert_allclose(covariance[:2, :2], ned[::-1, ::-1])
    assert pose(row(make_fix(1.0, lost=True)), 0.0) is None


def test_the_age_for_ros_is_that_of_the_capture():
    """Stamped when it was published, a position was as late as camera and computer together."""
    age = runpy.run_path(str(EXAMPLE))["age"]
    live = row(make_fix(time.monotonic() - 0.2, latency=0.15))
    assert age(live) == pytest.approx(0.2, abs=0.05)
    assert age(row(make_fix(1e12, latency=0.15))) == 0.15  # a recording's clock


def test_the_node_for_ros_reads_a_log_and_leaves_the_words_of_ros_to_it(log, monkeypatch, capsys):
    """With stand-ins for the three packages of ROS that it imports."""
    packages = ("rclpy", "rclpy.duration", "rclpy.utilities", "geometry_msgs.msg")
    ros = {name: MagicMock() for name in packages}
    ros["rclpy.utilities"].remove_ros_args = lambda argv: argv[: argv.index("--ros-args")]
    for name, module in ros.items():
        monkeypatch.setitem(sys.modules, name, module)
    monkeypatch.setitem(sys.modules, "geometry_msgs", MagicMock())
    words = "node --heading 84 --ros-args -r position:=/vision/pose".split()
    monkeypatch.setattr(sys, "argv", words)
    monkeypatch.setattr(sys, "stdin", log.open())
    runpy.run_path(str(EXAMPLE), run_name="__main__")
    publish = ros["rclpy"].create_node.return_value.create_publisher.return_value.publish
    assert publish.call_count == 2
