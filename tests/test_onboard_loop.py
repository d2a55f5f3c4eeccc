"""The loop: replay equality, and every fault that it must survive, injected one by one."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time

import numpy as np
import pytest
from conftest import small_flight
from onboard_tools import AREA, Clock, room, room_map
from patience import eventually

from trexton.flights import Flight, write_flight
from trexton.localizer import Localizer, TextonMap
from trexton.onboard import Fix, Onboard
from trexton.onboard.clock import StampKeeper
from trexton.onboard.inspection import Inspector
from trexton.onboard.sinks import Guard, Sink
from trexton.onboard.sources import CameraLost, Frame, Source
from trexton.onboard.sources.flight import FlightSource
from trexton.onboard.tally import FAULTS, Latencies, Tally
from trexton.simulator import Plan, random_waypoints
from trexton.streams import stream


class Kept(Sink):
    """Keeps the fixes."""

    def __init__(self):
        self.fixes: list[Fix] = []

    def open(self): ...

    def write(self, fix):
        self.fixes.append(fix)


def run(
    localizer: Localizer,
    source: Source,
    stop: threading.Event | None = None,
    sink: Sink | None = None,
    **options,
):
    """The fixes, the tally and the summary of a run to the source's end."""
    tally, kept = Tally(), sink or Kept()
    if not source.live:
        options.setdefault("rate", 0.1)  # a busy machine must not make a frame late here
    summary = Onboard(localizer, source, [Guard(kept, tally)], tally=tally, **options).run(
        stop or threading.Event()
    )
    return getattr(kept, "fixes", None), tally, summary


def histogram_map(flight: Flight) -> TextonMap:
    return TextonMap.train(flight.part("train"), neighbors=3, rng=np.random.default_rng(1))


def room_localizer(**options) -> Localizer:
    return Localizer(room_map(), rng=np.random.default_rng(4), **options)


class Film(Source):
    """A recording of given pictures, 0.08 s apart."""

    live = False

    def __init__(self, pictures, period=0.08):
        self.pictures, self.period, self.index = list(pictures), period, 0

    def open(self): ...

    def read(self):
        if self.index == len(self.pictures):
            return None
        self.index += 1
        return Frame((self.index - 1) * self.period, self.pictures[self.index - 1])


@pytest.fixture(scope="module")
def film() -> list[np.ndarray]:
    """Forty frames of a flight in the small room."""
    simulator, plan = room(6), Plan(random_waypoints(AREA, np.random.default_rng(6)))
    pictures = []
    for _ in range(40):
        simulator.step(plan.goal(simulator.state.position))
        pictures.append(simulator.render())
    return pictures


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
        path = texton_map.save(tmp_path / "map.npz")
        notebook = Localizer(texton_map, rng=stream(7, "flight", 0))
        expected = [notebook.step(histogram) for histogram in flight.part("test").histograms]
        command = [
            sys.executable,
            "-m",
            "trexton.cli",
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
        texton_map = TextonMap.train(cyberzoo.part("train"), rng=np.random.default_rng(1))
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

    def test_uncertainty_grows_and_staleness_comes_while_nothing_can_be_used(self, film):
        fixes, tally = self.inject(film, None, count=12)
        blind = fixes[10:22]
        assert tally.faults == {"corrupt": 12}
        assert [fix.stale for fix in blind] == [False] * 6 + [True] * 6  # 0.5 s are six periods
        assert np.linalg.det(blind[-1].covariance) > 2 * np.linalg.det(blind[0].covariance)
        assert not fixes[22].stale and fixes[22].usable

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
        fixes, _, _ = run(room_localizer(), Film([None, None, *film[:20]]))
        assert not fixes[0].usable and not fixes[1].usable
        assert all(fix.usable for fix in fixes[12:])


class TestInspector:
    def test_each_fault_and_none(self, rng):
        inspector = Inspector((24, 32))
        noise = rng.integers(0, 256, (24, 32, 3), dtype=np.uint8)
        assert inspector.check(noise) is None
        assert inspector.check(noise) == "frozen"
        assert inspector.frozen == 1
        assert inspector.check(noise[:, ::-1]) is None
        assert inspector.frozen == 0
        assert inspector.check(np.zeros((24, 32, 3), np.uint8)) == "dark"
        assert inspector.check(np.full((24, 32, 3), 255, np.uint8)) == "bright"
        assert inspector.check(noise[:12]) == "size"
        assert inspector.check(np.zeros(20)) is None
        assert Inspector(None).check(noise[:12]) is None


class TestClocks:
    def keeper(self):
        clock, wall, tally = Clock(100.0), Clock(1e9), Tally()
        return StampKeeper(tally, clock, wall), clock, wall, tally

    def pass_time(self, seconds, *clocks):
        for clock in clocks:
            clock.now += seconds

    def test_good_stamps_are_kept(self):
        keeper, clock, wall, tally = self.keeper()
        for _ in range(50):
            self.pass_time(0.08, clock, wall)
            assert keeper.keep(clock.now - 0.01) == clock.now - 0.01
        assert not tally.faults

    def test_stamps_of_another_clock_are_replaced(self):
        keeper, clock, wall, tally = self.keeper()
        assert keeper.keep(5e8) == 100.0
        assert tally["clock"] == 1

    def test_stamps_go_on_increasing_when_the_clock_goes_back(self):
        keeper, clock, wall, tally = self.keeper()
        stamps = []
        for step in range(20):
            self.pass_time(0.08, clock, wall)
            if step == 10:
                self.pass_time(-30.0, clock, wall)
            stamps.append(keeper.keep(clock.now))
        assert (np.diff(stamps) > 0).all()
        assert np.diff(stamps)[11:] == pytest.approx(0.08)
        assert tally["clock"] == 1

    def test_a_set_calendar_is_noticed_and_changes_nothing(self):
        keeper, clock, wall, tally = self.keeper()
        wall.now += 3600
        assert keeper.keep(100.0) == 100.0
        assert tally["clock"] == 1
        assert keeper.keep(100.08) == 100.08
        assert tally["clock"] == 1


class Live(Source):
    """A live camera on a script: a picture, an error to raise, or something to be done before the
    next of them."""

    def __init__(self, steps, clock=time.monotonic):
        self.steps, self.opened, self._clock = list(steps), 0, clock

    def open(self):
        self.opened += 1

    def read(self):
        while self.steps:
            step = self.steps.pop(0)
            if isinstance(step, Exception):
                raise step
            if not callable(step):
                return Frame(self._clock(), step)
            step()
        return None


class Unhurried(threading.Event):
    """A stop that never comes, and no pause between frames."""

    def wait(self, timeout=None):
        return self.is_set()


class Script:
    """What a script of `Live` does between pictures: it lets the clock go on, and waits for the
    loop."""

    def __init__(self, **options):
        self.clock, self.kept, self.options = Clock(), Kept(), options

    def run(self, steps, localizer=None, source_clock=None):
        source = Live(steps, source_clock or self.clock)
        options = {"clock": self.clock} | self.options
        fixes, tally, summary = run(
            localizer or room_localizer(), source, Unhurried(), self.kept, **options
        )
        return source, fixes, tally, summary

    def later(self, seconds):
        return lambda: self.clock.sleep(seconds)

    def seen(self, picture, after=0.08):
        """A picture, and the fix that came of it, a while later."""
        count = 0

        def before():
            nonlocal count
            count = len(self.kept.fixes)

        def passed():
            assert eventually(lambda: len(self.kept.fixes) > count)

        return [self.later(after), before, picture, passed]

    def blind(self):
        """Two periods of the map without a picture."""
        count = len(self.kept.fixes)
        self.clock.sleep(0.16)
        assert eventually(lambda: len(self.kept.fixes) > count)


class TestLive:
    def test_unplugged_predicts_goes_stale_and_comes_back(self, film):
        flight = Script(rate=50)
        source, fixes, tally, _ = flight.run(
            [
                *flight.seen(film[0]),
                *flight.seen(film[1]),
                CameraLost("unplugged"),
                *[flight.blind] * 8,
                *flight.seen(film[2]),
                *flight.seen(film[3]),
            ]
        )
        assert tally["camera"] == 1 and source.opened == 2
        assert tally["gap"] >= 8
        blind = [fix for fix in fixes if not fix.observed]
        assert not blind[0].stale and blind[-1].stale and all(fix.finite for fix in fixes)
        assert np.linalg.det(blind[-1].covariance) > np.linalg.det(blind[0].covariance)
        assert fixes[-1].observed and not fixes[-1].stale
        assert (np.diff([fix.time for fix in fixes]) > 0).all()

    def test_a_picture_frozen_for_long_has_the_camera_opened_again(self, film):
        flight = Script()
        frozen = [step for _ in range(61) for step in flight.seen(film[0])]
        source, fixes, tally, _ = flight.run(frozen)
        assert tally["frozen"] == 60 and len(fixes) == 61
        assert source.opened == 1 + 2  # after 26 and 52 repeats of 0.08 s

    def test_a_slow_frame_is_late_and_older_ones_are_dropped(self, film):
        flight, localizer = Script(rate=50), room_localizer()
        begun, filmed, quick = threading.Event(), threading.Event(), localizer.step

        def slow_once(picture, aiding=None):
            if picture is film[1]:
                begun.set()
                assert filmed.wait(120)
                flight.clock.sleep(0.1)
            return quick(picture)

        localizer.step = slow_once
        newer = [step for picture in film[2:12] for step in (flight.later(0.04), picture)]
        _, fixes, tally, summary = flight.run(
            [*flight.seen(film[0]), film[1], lambda: begun.wait(120), *newer, filmed.set],
            localizer,
        )
        assert tally["dropped"] == 9 and tally["frames"] == 3
        assert tally["late"] >= 1 and summary["missed_deadlines"] == tally["late"]
        assert max(fix.latency for fix in fixes) == pytest.approx(0.5)
        assert summary["latency_s"]["longest"] == pytest.approx(0.5)

    def test_missed_frames_are_predicted_over(self, film):
        flight, localizer = Script(), room_localizer()
        seen, step = [], localizer.step
        localizer.step = lambda picture, aiding=None: (
            seen.append(picture is not None) or step(picture)
        )
        flight.run(
            [*flight.seen(film[0]), *flight.seen(film[1]), *flight.seen(film[2], 0.4)], localizer
        )
        assert seen.count(True) == 3
        assert seen.count(False) == 4  # 0.4 s are five periods of the map

    def test_jumping_capture_stamps_never_reach_a_sink(self, film):
        jumps = iter([0.0, 0.0, 1e6, -1e6, 3e8, 0.0, 0.0, 0.0])
        flight = Script(clock=time.monotonic)
        _, fixes, tally, _ = flight.run(
            [step for picture in film[:8] for step in flight.seen(picture)],
            source_clock=lambda: time.monotonic() + next(jumps),
        )
        stamps = np.array([fix.time for fix in fixes])
        assert (np.diff(stamps) > 0).all()
        assert abs(stamps - time.monotonic()).max() < 600
        assert tally["clock"] == 3

    def test_a_sink_that_fails_leaves_the_others_alone(self, film):
        class Broken(Sink):
            name = "broken"

            def open(self): ...

            def write(self, fix):
                raise OSError(28, "No space left on device")

        tally, kept = Tally(), Kept()
        log = Guard(Broken(), tally)
        Onboard(room_localizer(), Film(film[:20]), [Guard(kept, tally)], tally=tally, log=log).run(
            threading.Event()
        )
        assert len(kept.fixes) == 20
        assert tally["output"] >= 1


def test_every_fault_says_what_is_done_about_it():
    assert all(len(deed.split()) > 3 for deed in FAULTS.values())


def test_latencies_in_constant_memory():
    latencies = Latencies(size=10)
    for value in range(100):
        latencies.add(value)
    assert (latencies.count, latencies.longest) == (100, 99)
    assert latencies.quantile(0) == 90 and latencies.quantile(1) == 99


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signals_end_the_flight_in_order(number, tmp_path):
    flight_folder = write_flight(small_flight(120), tmp_path / "flight")
    path = histogram_map(small_flight(120)).save(tmp_path / "map.npz")
    log = tmp_path / "log"
    command = [
        sys.executable,
        "-m",
        "trexton.cli",
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


def test_a_step_that_takes_long_makes_a_stale_fix(film):
    """Age counts from capture to report: a stamp compared with itself is always fresh."""
    localizer = room_localizer()
    clock, quick = Clock(), localizer.step

    def slow(picture, aiding=None):
        clock.now += 1.2
        return quick(picture)

    localizer.step = slow
    kept, tally = Kept(), Tally()
    source = Live([film[0]], clock=clock)
    Onboard(localizer, source, [Guard(kept, tally)], tally=tally, clock=clock).run(
        threading.Event()
    )
    assert kept.fixes[0].observed and kept.fixes[0].latency >= 1.2
    assert kept.fixes[0].stale and not kept.fixes[0].usable


def test_frames_are_numbered_as_the_flight_numbers_them():
    flight = small_flight(60)
    fixes, _, _ = run(
        Localizer(histogram_map(flight), rng=np.random.default_rng(1)),
        FlightSource(flight, laps=2),
    )
    lap = [int(number) for number in flight.frame]
    assert [fix.number for fix in fixes] == lap + [number + lap[-1] + 1 for number in lap]


def test_a_number_of_frames_ends_even_where_none_comes(film):
    clock = Clock()

    class Never(Live):
        def read(self):
            clock.now += 11
            raise CameraLost("nothing there")

    with pytest.raises(CameraLost, match="no frame in"):
        Onboard(room_localizer(), Never([]), [], tally=Tally(), clock=clock, frames=5).run(
            threading.Event()
        )
