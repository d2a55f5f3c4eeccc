"""The loop: replay equality, and every fault of a frame that it must survive."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading

import numpy as np
import pytest
from conftest import small_flight
from onboard_flying import Film, filmed, histogram_map, room_localizer, run
from onboard_tools import AREA, Clock, field_map, room
from patience import eventually

from trexton.base.streams import stream
from trexton.flights.writing import write_flight
from trexton.localization.localizer import Localizer
from trexton.localization.map_files import save_map
from trexton.localization.training import train_map
from trexton.onboard.fix import Fix
from trexton.onboard.loop import Onboard
from trexton.onboard.sources.recorded import FlightSource
from trexton.onboard.tally import Tally
from trexton.simulator.recording import Plan, random_waypoints


@pytest.fixture
def film() -> list[np.ndarray]:
    return filmed()


class TestReplayEquality:
    """The notebooks and the onboard script give the same estimates, bit for bit."""

    @pytest.mark.parametrize("recovery", ["none", "augmented"])
    def test_images(self, film, recovery):
        notebook = room_localizer(recovery=recovery)
        expected = [notebook.step(picture) for picture in film]
        fixes, tally, _ = run(room_localizer(recovery=recovery), Film(film))
        assert len(fixes) == len(expected) and not tally.faults
        for fix, estimate in zip(fixes, expected, strict=False):
            assert fix.position.tobytes() == estimate.position.tobytes()
            assert fix.spread.tobytes() == estimate.spread.tobytes()
            assert fix.observed == estimate.observed and fix.lost >= estimate.lost

    def test_histograms_through_the_command_line(self, tmp_path):
        flight = small_flight(120)
        flight_folder = write_flight(flight, tmp_path / "flight")
        texton_map = histogram_map(flight)
        path = save_map(texton_map, tmp_path / "map.npz")
        notebook = Localizer(texton_map, rng=stream(7, "flight", 0))
        expected = [notebook.step(histogram) for histogram in flight.part("test").histograms]
        command = [
            sys.executable,
            "-m",
            "trexton",
            "onboard",
            str(path),
            "--camera",
            f"{flight_folder}#test",
            "--seed",
            "7",
            "--log",
            str(tmp_path / "log"),
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=True)
        rows = [json.loads(line) for line in done.stdout.splitlines()]
        assert [(row["x_m"], row["y_m"]) for row in rows] == [
            tuple(estimate.position.tolist()) for estimate in expected
        ]
        assert [(row["std_x_m"], row["std_y_m"]) for row in rows] == [
            tuple(estimate.spread.tolist()) for estimate in expected
        ]
        assert '"frames": 60' in done.stderr
        log = [json.loads(line) for line in (tmp_path / "log").read_text().splitlines()]
        assert log[-1]["event"] == "end" and log[-1]["frames"] == 60

    def test_on_the_authors_flight(self, cyberzoo):
        texton_map = train_map(cyberzoo.part("train"), rng=np.random.default_rng(1))
        test = cyberzoo.part("test")
        notebook = Localizer(texton_map, rng=np.random.default_rng(2))
        expected = np.array([notebook.step(histogram).position for histogram in test.histograms])
        fixes, _, _ = run(Localizer(texton_map, rng=np.random.default_rng(2)), FlightSource(test))
        assert np.array([fix.position for fix in fixes]).tobytes() == expected.tobytes()


class TestBadFrames:
    """A frame that cannot be used is counted, and the filter only predicts."""

    def inject(self, film, bad, count=1) -> tuple[list[Fix], Tally]:
        fixes, tally, _ = run(room_localizer(), Film(film[:10] + [bad] * count + film[10:20]))
        return fixes, tally

    @pytest.mark.parametrize(
        ("fault", "picture"),
        [
            ("corrupt", None),
            ("dark", np.full((96, 128, 3), 5, np.uint8)),
            ("bright", np.full((96, 128, 3), 250, np.uint8)),
            ("size", np.full((48, 64, 3), 100, np.uint8)),
            ("misfit", np.full((96, 128, 4), 100, np.uint8)),
            ("misfit", np.full(5, np.nan)),
        ],
    )
    def test_predicted_and_counted(self, film, fault, picture):
        fixes, tally = self.inject(film, picture)
        assert tally.faults == {fault: 1}
        assert [fix.observed for fix in fixes] == [True] * 10 + [False] + [True] * 10
        assert fixes[10].fault == fault
        assert all(fix.finite for fix in fixes)

    def test_a_camera_of_another_size_is_named_once(self, film, capsys):
        """Each frame was counted, and nobody told which size had come, and which was wanted."""
        self.inject(film, np.full((48, 64, 3), 100, np.uint8), count=3)
        said = capsys.readouterr().err
        assert said.count("frames of 64x48, and a map of 128x96: set the camera to that") == 1

    def test_uncertainty_grows_and_staleness_comes_while_nothing_can_be_used(self, film):
        fixes, tally = self.inject(film, None, count=12)
        blind = fixes[10:22]
        assert tally.faults == {"corrupt": 12}
        assert [fix.stale for fix in blind] == [False] * 6 + [True] * 6  # 0.5 s are six periods
        assert np.linalg.det(blind[-1].covariance) > 2 * np.linalg.det(blind[0].covariance)
        assert not fixes[22].stale and fixes[22].observed

    def test_a_frozen_picture(self, film):
        fixes, tally = self.inject(film, film[9], count=8)
        assert tally.faults == {"frozen": 8}
        assert [fix.observed for fix in fixes] == [True] * 10 + [False] * 8 + [True] * 10

    def test_a_burst_of_random_bytes_costs_trust_and_is_survived(self, film, rng):
        noise = [rng.integers(0, 256, film[0].shape, dtype=np.uint8) for _ in range(5)]
        fixes, tally, _ = run(
            room_localizer(recovery="augmented"), Film(film[:10] + noise + film[10:])
        )
        assert all(fix.finite for fix in fixes)
        assert len(fixes) == 45

    def test_before_the_first_good_frame_nothing_is_usable(self, film):
        fixes, _, _ = run(room_localizer(), Film([None, None, *film[:34]]))
        assert not fixes[0].usable and not fixes[1].usable
        assert all(fix.usable for fix in fixes[26:])


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_the_flight_in_order(number, tmp_path):
    flight_folder = write_flight(small_flight(120), tmp_path / "flight")
    path = save_map(histogram_map(small_flight(120)), tmp_path / "map.npz")
    log = tmp_path / "log"
    command = [
        sys.executable,
        "-m",
        "trexton",
        "onboard",
        str(path),
        "--camera",
        str(flight_folder),
        "--pace",
        "stamps",
        "--laps",
        "1000",
        "--output",
        f"csv:{tmp_path}/out.csv",
        "--log",
        str(log),
    ]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    try:
        assert eventually(lambda: log.exists() and log.stat().st_size > 0)
        process.send_signal(number)
        _, errors = process.communicate(timeout=120)
    finally:
        process.kill()
    assert process.returncode == 0
    assert "Traceback" not in errors and '"frames"' in errors
    assert json.loads(log.read_text().splitlines()[-1])["event"] == "end"
    assert (tmp_path / "out.csv").read_text().endswith("\n")


def test_status_line_once_a_second_tells_the_faults(capsys):
    clock = Clock()
    flight = small_flight(120)
    pictures = list(flight.histograms) + [None] * 3
    loop = Onboard(
        Localizer(histogram_map(flight), rng=np.random.default_rng(1)),
        Film(pictures),
        [],
        tally=Tally(),
        clock=clock,
    )
    loop.run(threading.Event())
    assert len(capsys.readouterr().err.splitlines()) == 1  # the clock stands still
    line = loop.status.line(loop._fix, clock.now + 1)
    assert "123 frames" in line and "corrupt 3" in line and "spread" in line


def test_kidnapped_and_found_again():
    """Teleported, the vehicle is declared lost, and found again by the particles that are
    injected.
    """
    localizer = room_localizer(recovery="augmented")
    simulator, plan = room(8), Plan(random_waypoints(AREA, np.random.default_rng(8)))
    places = [np.array([0.7, 0.7]), np.array([3.3, 3.3])]

    def fly(frames):
        for _ in range(frames):
            simulator.step(plan.goal(simulator.state.position))
            yield localizer.step(simulator.render()), simulator.state.position[:2]

    list(fly(100))
    declared, recovered = 0, []
    for number in range(8):
        simulator.vehicle.teleport(places[number % 2])
        track = list(fly(80))
        errors = [np.hypot(*(estimate.position - truth)) for estimate, truth in track]
        recovered.append(next((index for index, error in enumerate(errors) if error < 0.8), None))
        declared += any(Fix.of(estimate, 0.0, 1, AREA, 0.08).lost for estimate, _ in track[:10])
    assert all(index is not None and index < 25 for index in recovered)
    assert declared >= 2  # most are found within a few frames, before the particles have spread


def test_frames_are_numbered_as_the_flight_numbers_them():
    flight = small_flight(60)
    fixes, _, _ = run(
        Localizer(histogram_map(flight), rng=np.random.default_rng(1)),
        FlightSource(flight, laps=2),
    )
    lap = [int(number) for number in flight.frame]
    assert [fix.number for fix in fixes] == lap + [number + lap[-1] + 1 for number in lap]


def test_a_recording_is_fused_at_its_own_rate_whatever_rate_is_asked_for(film):
    """Its frames all come: a rate lower than theirs claimed too much of each."""
    fused = []
    for rate in (0.1, 100.0):
        localizer = Localizer(field_map(), rng=np.random.default_rng(1))
        fixes, *_ = run(localizer, Film(film[:30]), rate=rate)
        fused.append([fix.fusion.covariance for fix in fixes])
    np.testing.assert_array_equal(*fused)
