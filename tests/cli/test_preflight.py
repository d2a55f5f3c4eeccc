"""Before take-off: what is as it should be and what is not; nothing is written or commanded."""

from __future__ import annotations

import shutil
import threading
import time
from contextlib import contextmanager
from dataclasses import replace

import cv2
import numpy as np
import pytest
from onboard_tools import CAMERA, colourful_floor, mavlink, room_map

pytest.importorskip("pymavlink", reason="the extra 'mavlink' is not installed")

from onboard_autopilot import AUTOPILOT_HEARTBEAT, Peer
from pymavlink.dialects.v20 import ardupilotmega as dialect

from trexton.base.errors import FlightError
from trexton.cli import preflight as module
from trexton.cli.main import main
from trexton.cli.preflight import preflight
from trexton.flights.folder import read_flight
from trexton.flights.writing import write_flight
from trexton.localization.map_files import save_map
from trexton.localization.training import train_map
from trexton.onboard.settings import Flying, Landing, MapPlacement, Settings
from trexton.simulator.recording import record_flight
from trexton.simulator.sensor import Effects


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A map file, and a flight over the same floor."""
    folder = tmp_path_factory.mktemp("preflight")
    record_flight(
        folder / "flight", pattern="waypoints", frames=30, camera=CAMERA, floor=colourful_floor()
    )
    return str(save_map(room_map(), folder / "map.npz")), str(folder / "flight")


def checked(place, **options) -> dict[str, bool]:
    settings = Settings(place[0], (), (), {Flying: Flying(camera=place[1]), **options})
    return {check.name: check.holds for check in preflight(settings, 1.0)}


@pytest.fixture
def every_frame(monkeypatch):
    """Flights are played frame by frame: at their own pace a busy computer drops most of them."""

    def build(settings):
        onboard = built(settings)
        onboard.source.live = False
        return onboard

    built = module.build
    monkeypatch.setattr(module, "build", build)


def spoilt(place, tmp_path, change) -> tuple[str, str]:
    """The same flight, its pictures changed."""
    folder = shutil.copytree(place[1], tmp_path / "spoilt")
    for file in read_flight(folder).frames.files:
        cv2.imwrite(str(file), change(cv2.imread(str(file))))
    return place[0], str(folder)


def test_all_is_well_and_nothing_is_written_nor_commanded(place, tmp_path, capsys):
    log, table = tmp_path / "log", tmp_path / "a.csv"
    words = ["onboard", place[0], "--camera", place[1], "--preflight", "--quiet"]
    words += ["--log", str(log), "--output", f"csv:{table}"]
    assert main(words) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0].split()[1] for line in lines] == ["camera", "map"]
    assert all(line.startswith("ok ") for line in lines) and "128x96" in lines[0]
    assert not log.exists() and not table.exists()


def test_another_floor(place, tmp_path):
    found = checked(spoilt(place, tmp_path, lambda image: 255 - image // 2))
    assert found["camera"] and not found["map"]


def test_another_size(place, tmp_path):
    with pytest.raises(FlightError, match="images of 64x64 pixels where images of 128x96"):
        checked(spoilt(place, tmp_path, lambda image: image[:64, :64]))


def test_a_vehicle_that_takes_no_position(place, every_frame):
    """It was `ok`: that nothing is answered is no proof that anything is sent."""
    pytest.importorskip("cflib", reason="the extra 'crazyflie' is not installed")
    settings = Settings(place[0], ("crazyflie:sea://1",), (), {Flying: Flying(camera=place[1])})
    (link,) = (each for each in preflight(settings, 60.0) if each.name == "link")
    assert not link.holds and "took no positions" in link.words


def test_no_camera(place, capsys, monkeypatch):
    monkeypatch.setattr(preflight, "__defaults__", (1.0,))  # seconds of waiting in vain
    words = ["onboard", place[0], "--camera", "/dev/video97", "--preflight", "--quiet"]
    assert main(words) == 1
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 2 and all(line.startswith("FAIL") for line in lines)
    assert "gives no frames" in lines[0]


ASKEW_DEG = (0.0, 4.0)


@pytest.fixture(scope="module")
def flight_and_map(tmp_path_factory):
    """A flight, and the file of a map for method fine that it was trained on."""
    folder = tmp_path_factory.mktemp("mounts")
    flight = record_flight(
        folder / "flight", frames=60, speed=1.0, camera=CAMERA, floor=colourful_floor()
    )
    texton_map = train_map(flight, method="fine", n_textons=6, rng=np.random.default_rng(1))
    return flight, str(save_map(texton_map, folder / "fine.npz"))


@pytest.mark.parametrize("degrees", ASKEW_DEG)
def test_a_camera_that_looks_askew_is_told(flight_and_map, degrees, tmp_path, every_frame):
    flight, file = flight_and_map
    askew = replace(flight, attitude=flight.attitude + np.radians([0.0, degrees, 0.0]))
    camera = str(write_flight(askew, tmp_path / "askew"))
    found = preflight(Settings(file, (), (), {Flying: Flying(camera=camera)}), 60.0)
    told = [check.words for check in found if check.name == "attitude"]
    assert len(told) == (degrees > 0) and all("camera's mount" in words for words in told)


# Seconds by which the attitude runs ahead of the frames, None where it has the other sign; the
# delay that was given; and what is said.
DELAYS = [
    (0.0, 0.0, "frames come"),
    (0.24, 0.0, "add --camera-delay 0.2"),
    (0.24, 0.24, "0.24 given"),
    (0.7, 0.0, "look for a quicker camera"),
    (None, 0.0, "turns against the vehicle"),
]


@pytest.fixture(scope="module")
def turning(tmp_path_factory):
    """A flight that turns."""
    return record_flight(
        tmp_path_factory.mktemp("delays") / "flight", pattern="waypoints", frames=75,
        camera=CAMERA, floor=colourful_floor(), effects=Effects(yaw=0.3),
    )  # fmt: skip


@pytest.mark.parametrize(("late", "given", "words"), DELAYS)
def test_a_camera_that_is_late_is_told(place, turning, late, given, words, tmp_path, every_frame):
    yaw = turning.attitude[:, 2]
    yaw = -yaw if late is None else np.interp(turning.time + late, turning.time, yaw)
    attitude = np.column_stack([turning.attitude[:, :2], yaw])
    camera = write_flight(replace(turning, attitude=attitude), tmp_path / "late")
    flying = Flying(camera=str(camera), camera_delay=given)
    checks = preflight(Settings(place[0], (), (), {Flying: flying}), 60.0)
    found = {check.name: check for check in checks}["delay"]
    assert found.holds == (late == given) and words in found.words


class Later:
    """A clock that can be set ahead."""

    by = 0.0

    def monotonic(self) -> float:
        return time.monotonic() + self.by


@contextmanager
def alive(*messages):
    """An autopilot that beats and says these from the first datagram on that it hears."""
    peer, done = Peer(), threading.Event()

    def beat():
        while not done.wait(0.1):
            if peer.address is not None:
                peer.send(AUTOPILOT_HEARTBEAT, *messages)

    thread = threading.Thread(target=beat, daemon=True)
    thread.start()
    try:
        yield peer
    finally:
        done.set()
        thread.join()
        peer.close()


FUSED = dialect.MAVLink_estimator_status_message(0, 8, *[0.0] * 8)
ORIGIN = dialect.MAVLink_gps_global_origin_message(520_000_000, 40_000_000, 0)


class TestAutopilot:
    """An autopilot over the wire."""

    def links(self, place, port: int, options=None, heading=None, camera="") -> dict[str, bool]:
        changes = {
            Flying: Flying(camera=camera or place[1]), MapPlacement: MapPlacement(heading=heading),
            Landing: Landing(land="2,2", arm_landing=True), **(options or {}),
        }  # fmt: skip
        settings = Settings(place[0], (f"udpout:127.0.0.1:{port}",), (), changes)
        return {check.name: check.holds for check in preflight(settings, 1.0)}

    def test_one_that_fuses(self, place, monkeypatch):
        """However long it then takes to look at the frames: a first start compiles kernels."""
        look, clock = module._of_map, Later()

        def looks_long(*seen):
            clock.by = 60.0
            return look(*seen)

        monkeypatch.setattr(module, "_of_map", looks_long)
        monkeypatch.setattr(module, "time", clock)
        with alive(FUSED, ORIGIN) as peer:
            found = self.links(place, peer.port, mavlink(origin="52,4,0"), heading=0.0)
        assert found["link"] and found["fused"] and found["origin"] and found["heading"]
        assert not [m for m in peer.of("COMMAND_LONG") if m.command == 21]

    def test_without_a_camera_the_link_is_heard_and_no_origin_is_taken_for_set(self, place):
        with alive(FUSED) as peer:
            found = self.links(place, peer.port, mavlink(origin="52,4,0"), 84.0, "/dev/video98")
        assert found["link"] and found["fused"] and found["heading"]
        assert not found["camera"] and not found["origin"]
        assert peer.of("SET_GPS_GLOBAL_ORIGIN") and not peer.of("VISION_POSITION_ESTIMATE")

    def test_a_zone_that_is_sent_as_a_target_is_there_before_take_off_too(self, place):
        """The check refused what the flight takes: the zone was left out with the landing."""
        with alive(FUSED) as peer:
            found = self.links(place, peer.port, mavlink(landing_target=True), heading=0.0)
        assert found["link"] and not [m for m in peer.of("COMMAND_LONG") if m.command == 21]

    def test_one_that_is_silent(self, place):
        found = self.links(place, 9, mavlink(autopilot="ardupilot"))
        assert not (found["link"] or found["fused"] or found["origin"] or found["heading"])
        assert found["camera"]
