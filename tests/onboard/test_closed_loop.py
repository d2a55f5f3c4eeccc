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
from onboard_tools import CAMERA, field_map, room, room_map
from patience import eventually

from trexton.localization.map_files import save_map

pytest.importorskip("pymavlink", reason="the extra 'mavlink' is not installed")

from onboard_autopilot import ATTITUDE, Autopilot, mavlink  # noqa: E402

ZONE = np.array([2.6, 1.4])
FRAME_S = 0.02  # four times as fast as life: a frame of the simulator is 0.08 s of flight


def film(stream, picture: np.ndarray) -> None:
    """One frame of Y4M: planes of Y, U, V."""
    stream.write(b"FRAME\n" + np.ascontiguousarray(picture.transpose(2, 0, 1)).tobytes())


class Flight:
    """The vehicle over the room, whose camera the script watches through a pipe."""

    def __init__(self, folder, autopilot, simulator, *more: str, texton_map=None, frame_s=FRAME_S):
        self.simulator, self._log, self._frame_s = simulator, folder / "log", frame_s
        camera = folder / "camera.y4m"
        os.mkfifo(camera)
        self.script = subprocess.Popen(
            [
                *(sys.executable, "-m", "trexton", "onboard"),
                str(save_map(texton_map or room_map(), folder / "map.npz")),
                *("--camera", str(camera), "--rate", f"{1 / frame_s:g}", "--log", str(self._log)),
                *("--output", f"udpout:127.0.0.1:{autopilot.port}"),
                *("--land", f"{ZONE[0]},{ZONE[1]}", "--radius", "1.0"),
                *(() if "touchdown" in more else ("--spread", "0.8")),
                *("--arm-landing", *more),
            ],
            stderr=subprocess.PIPE,
            text=True,
        )
        descriptor = eventually(lambda: self._opened(camera))
        os.set_blocking(descriptor, True)
        self._stream = open(descriptor, "wb", buffering=0)
        self._stream.write(
            b"YUV4MPEG2 W%d H%d F25:2 Ip A1:1 C444 XCOLORRANGE=FULL\n"
            % (CAMERA.width, CAMERA.height)
        )
        assert eventually(lambda: self.film() or autopilot.address is not None)

    def _opened(self, camera) -> int | None:
        """The pipe once the script reads it; a script that ended would be waited for for ever."""
        assert self.script.poll() is None, self.script.stderr.read()
        try:
            return os.open(camera, os.O_WRONLY | os.O_NONBLOCK)
        except OSError:
            return None

    def film(self) -> None:
        film(self._stream, self.simulator.render())
        time.sleep(self._frame_s)

    def fly_until(self, true, frames: int = 1500) -> bool:
        for _ in range(frames):
            self.simulator.step(ZONE)
            self.film()
            if true():
                return True
        return False

    def end(self) -> list[dict]:
        """The log's events, once the script has ended as it should."""
        self.script.send_signal(signal.SIGTERM)
        _, errors = self.script.communicate(timeout=120)
        assert self.script.returncode == 0, errors
        return [
            row for row in map(json.loads, self._log.read_text().splitlines()) if "event" in row
        ]

    def close(self) -> None:
        self.script.kill()
        self.script.communicate()
        self._stream.close()


@pytest.mark.parametrize("manner", ["accepts", "denies", "is silent"])
def test_landing_over_mavlink(manner, tmp_path):
    simulator = room(11, start=(0.8, 3.2))
    autopilot = Autopilot(manner, simulator.vehicle.land)
    flight = Flight(tmp_path, autopilot, simulator)
    try:
        done = {
            "accepts": lambda: simulator.state.landed,
            "denies": lambda: bool(autopilot.commands),
            "is silent": lambda: 1 in autopilot.commands,
        }
        assert flight.fly_until(done[manner])
        for _ in range(10):  # it goes on after the landing, the refusal, the silence
            flight.film()
        events = flight.end()
    finally:
        flight.close()
        autopilot.close()
    states = [event["state"] for event in events if event["event"] == "landing"]
    assert states[0].startswith("asked")
    assert events[-1]["event"] == "end" and events[-1]["landing"] == states[-1]
    if manner == "accepts":
        assert "LANDING" in states and autopilot.commands[0] == 0
        assert np.hypot(*(simulator.state.position[:2] - ZONE)) < 1.8
    elif manner == "denies":
        assert "REFUSED" in states and set(autopilot.commands) == {0}
        assert not simulator.state.landed
    else:
        assert "LANDING" not in states and not simulator.state.landed
    check_positions(autopilot, simulator)


def test_a_predicted_touchdown_lands_in_the_zone(tmp_path):
    simulator = room(11, start=(0.8, 3.2))
    autopilot = Autopilot("accepts", simulator.vehicle.land)
    # A filter that knows how fast the vehicle flies is flown as fast as life.
    more = ("--trigger", "touchdown")
    flight = Flight(tmp_path, autopilot, simulator, *more, texton_map=field_map(), frame_s=0.08)
    try:
        assert flight.fly_until(lambda: simulator.state.landed)
        events = flight.end()
    finally:
        flight.close()
        autopilot.close()
    states = [event["state"] for event in events if event["event"] == "landing"]
    assert states[:2] == ["asked to land, no answer yet", "LANDING"]
    assert np.hypot(*(simulator.state.position[:2] - ZONE)) < 1.0


def test_it_dies_and_starts_anew_among_others(tmp_path):
    simulator = room(11, start=(0.8, 3.2))
    autopilot = Autopilot("accepts", simulator.vehicle.land, company=True)
    flight = Flight(tmp_path, autopilot, simulator, "--target", "1", "--origin", "52,4,0")
    try:
        assert flight.fly_until(lambda: autopilot.of("SET_GPS_GLOBAL_ORIGIN"))
        autopilot.send(mavlink.MAVLink_gps_global_origin_message(520000000, 40000000, 0))
        autopilot.alive = False
        for _ in range(5):
            flight.film()
        assert not simulator.state.landed and not autopilot.commands
        before = {m.target_system for m in autopilot.of("COMMAND_LONG")}
        autopilot.restart()
        assert flight.fly_until(
            lambda: simulator.state.landed and autopilot.of("SET_GPS_GLOBAL_ORIGIN")
        )
        events = flight.end()
    finally:
        flight.close()
        autopilot.close()
    assert "autopilot restarted" in [event["event"] for event in events]
    asked = autopilot.of("COMMAND_LONG")
    assert before | {message.target_system for message in asked} == {1}
    intervals = {message.param1 for message in asked if message.command == 511}
    assert mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE in intervals  # asked for once more
    states = [event["state"] for event in events if event["event"] == "landing"]
    assert "LANDING" in states and "REFUSED" not in states  # the other's denial is not ours
    check_positions(autopilot, simulator)


def check_positions(autopilot: Autopilot, simulator) -> None:
    """What the autopilot was told: finite, stamped in order, with its own attitude, somewhere in
    the room.
    """
    sent = autopilot.of("VISION_POSITION_ESTIMATE")
    assert len(sent) > 10  # each image once; a refusal may come within two seconds
    assert (np.diff([message.usec for message in sent]) > 0).all()
    place = np.array(
        [(message.y, message.x) for message in sent]
    )  # heading 0: north is the map's y
    assert np.isfinite(place).all() and (np.abs(place - 2.0) < 4.0).all()
    assert min(message.covariance[0] for message in sent) > 0
    assert sent[-1].yaw == pytest.approx(ATTITUDE[2])
