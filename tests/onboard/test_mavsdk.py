"""A second implementation of MAVLink reads what is sent; opt in with ``TREXTON_MAVSDK=1``."""

from __future__ import annotations

import asyncio
import json
import os
import socket
import threading
import time
import warnings

import pytest
from onboard_tools import make_fix, surroundings
from onboard_tools import mavlink as mavlink_options

if not os.environ.get("TREXTON_MAVSDK"):
    pytest.skip("opt in with TREXTON_MAVSDK=1", allow_module_level=True)
pytest.importorskip("pymavlink")

from onboard_autopilot import ATTITUDE, AUTOPILOT_HEARTBEAT, mavlink  # noqa: E402

from trexton.onboard.mavlink.messages import quaternion  # noqa: E402
from trexton.onboard.sinks import open_sink  # noqa: E402

with warnings.catch_warnings():
    warnings.simplefilter("ignore")  # the next version has another name
    mavsdk = pytest.importorskip("mavsdk")


def free_port(kind: int) -> int:
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Vehicle:
    """An autopilot that only beats, and the sink that flies with it, both sending to MAVSDK."""

    def __init__(self, port: int, profile: str):
        self.port, self.sink = (
            port,
            open_sink(
                f"udpout:127.0.0.1:{port}", surroundings(), mavlink_options(autopilot=profile)
            ),
        )
        self.stop = threading.Event()
        self.thread = threading.Thread(target=self.run, daemon=True)

    def run(self) -> None:
        codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        attitude = mavlink.MAVLink_attitude_message(0, *ATTITUDE, 0, 0, 0)
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as wire:
            while not self.stop.wait(0.1):
                wire.sendto(AUTOPILOT_HEARTBEAT.pack(codec), ("127.0.0.1", self.port))
                # MAVSDK stands between the two and does not pass messages on: the sink hears its
                # autopilot
                # directly.
                for message in (AUTOPILOT_HEARTBEAT, attitude):
                    with self.sink._lock:
                        decoded = mavlink.MAVLink(None).parse_buffer(message.pack(codec))[0]
                        self.sink.speaker.listener.hear(decoded, time.monotonic())
                self.sink.write(make_fix(time.monotonic(), (1.5, 2.5), resets=3))

    def __enter__(self):
        self.sink.open()
        self.thread.start()
        return self

    def __exit__(self, *error):
        self.stop.set()
        self.thread.join()
        self.sink.close()


async def first_message(port: int, kind: str) -> tuple[int, int, dict]:
    drone = mavsdk.System(port=free_port(socket.SOCK_STREAM))
    await drone.connect(system_address=f"udpin://127.0.0.1:{port}")
    async for state in drone.core.connection_state():
        if state.is_connected:
            break
    async for message in drone.mavlink_direct.message(kind):
        if message.component_id == 191:
            return message.system_id, message.component_id, json.loads(message.fields_json)


def received(profile: str, kind: str) -> dict:
    port = free_port(socket.SOCK_DGRAM)
    with Vehicle(port, profile):
        system, component, fields = asyncio.run(asyncio.wait_for(first_message(port, kind), 60))
    assert (system, component) == (1, 191)
    return fields


def test_heartbeat():
    fields = received("px4", "HEARTBEAT")
    assert (fields["type"], fields["autopilot"]) == (18, 8)


def test_px4():
    fields = received("px4", "VISION_POSITION_ESTIMATE")
    assert (fields["x"], fields["y"], fields["z"], fields["reset_counter"]) == (2.5, 1.5, -1.0, 3)
    assert (fields["roll"], fields["pitch"], fields["yaw"]) == pytest.approx(ATTITUDE, abs=1e-5)
    assert (
        fields["covariance"][0] > 0.09
        and fields["covariance"][6] > 0.04
        and fields["covariance"][11] == 100
    )
    assert fields["covariance"][15] is None and fields["covariance"][2] is None  # JSON's NaN
    assert abs(fields["usec"] / 1e6 - time.monotonic()) < 120


def test_ardupilot():
    fields = received("ardupilot", "ODOMETRY")
    assert (fields["x"], fields["y"], fields["z"], fields["reset_counter"]) == (2.5, 1.5, -1.0, 3)
    assert (fields["frame_id"], fields["child_frame_id"], fields["estimator_type"]) == (20, 12, 2)
    assert fields["q"] == pytest.approx(quaternion(*ATTITUDE), abs=1e-5)
    assert 1 <= fields["quality"] <= 100
    assert fields["vx"] is None and all(value is not None for value in fields["pose_covariance"])
