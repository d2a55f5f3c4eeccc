"""A closed loop: the simulator as camera and vehicle, the onboard script in its own process, an
autopilot.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest
from onboard_tools import CAMERA, room, room_map
from patience import eventually

pytest.importorskip("pymavlink", reason="the extra 'mavlink' is not installed")

from onboard_autopilot import ATTITUDE, Autopilot  # noqa: E402

ZONE = np.array([2.6, 1.4])
FRAME_S = 0.02  # four times as fast as life: a frame of the simulator is 0.08 s of flight


def film(stream, picture: np.ndarray) -> None:
    """One frame of Y4M: planes of Y, U, V."""
    stream.write(b"FRAME\n" + np.ascontiguousarray(picture.transpose(2, 0, 1)).tobytes())


@pytest.mark.parametrize("manner", ["accepts", "denies", "is silent"])
def test_landing_over_mavlink(manner, tmp_path):
    simulator = room(11, start=(0.8, 3.2))
    autopilot = Autopilot(manner, simulator.vehicle.land)
    camera, log = tmp_path / "camera.y4m", tmp_path / "log"
    os.mkfifo(camera)
    command = [
        sys.executable,
        "-m",
        "trexton.cli",
        "onboard",
        str(room_map().save(tmp_path / "map.npz")),
        "--camera",
        str(camera),
        "--rate",
        "50",
        "--output",
        f"udpout:127.0.0.1:{autopilot.port}",
        "--log",
        str(log),
        "--land",
        f"{ZONE[0]},{ZONE[1]}",
        "--radius",
        "1.0",
        "--spread",
        "0.8",
        "--arm-landing",
    ]
    script = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        with open(camera, "wb", buffering=0) as stream:
            stream.write(
                b"YUV4MPEG2 W%d H%d F25:2 Ip A1:1 C444 XCOLORRANGE=FULL\n"
                % (CAMERA.width, CAMERA.height)
            )
            assert eventually(
                lambda: (
                    film(stream, simulator.render())
                    or simulator.step()
                    and autopilot.address is not None
                )
            )
            for _ in range(1500):
                state = simulator.step(ZONE)
                film(stream, simulator.render())
                time.sleep(FRAME_S)
                done = {
                    "accepts": state.landed,
                    "denies": bool(autopilot.commands),
                    "is silent": 1 in autopilot.commands,
                }
                if done[manner]:
                    break
            for _ in range(10):  # it goes on after the landing, the refusal, the silence
                film(
                    stream,
                    simulator.render()
                    if manner != "accepts"
                    else simulator.step() and simulator.render(),
                )
                time.sleep(FRAME_S)
            script.send_signal(signal.SIGTERM)
            _, errors = script.communicate(timeout=120)
    finally:
        script.kill()
        autopilot.close()
    assert script.returncode == 0, errors
    events = [row for row in map(json.loads, log.read_text().splitlines()) if "event" in row]
    states = [event["state"] for event in events if event["event"] == "landing"]
    assert states[0].startswith("asked")
    if manner == "accepts":
        assert "LANDING" in states and autopilot.commands[0] == 0
        assert simulator.state.landed
        assert np.hypot(*(simulator.state.position[:2] - ZONE)) < 1.8
    elif manner == "denies":
        assert "REFUSED" in states and set(autopilot.commands) == {0}
        assert not simulator.state.landed
    else:
        assert 1 in autopilot.commands and "LANDING" not in states
        assert not simulator.state.landed
    check_positions(autopilot, simulator)


def check_positions(autopilot: Autopilot, simulator) -> None:
    """What the autopilot was told: finite, stamped in order, with its own attitude, somewhere in
    the room.
    """
    sent = autopilot.of("VISION_POSITION_ESTIMATE")
    assert len(sent) > 20
    assert (np.diff([message.usec for message in sent]) > 0).all()
    place = np.array(
        [(message.y, message.x) for message in sent]
    )  # heading 0: north is the map's y
    assert np.isfinite(place).all() and (np.abs(place - 2.0) < 4.0).all()
    assert min(message.covariance[0] for message in sent) > 0
    assert sent[-1].yaw == pytest.approx(ATTITUDE[2])
