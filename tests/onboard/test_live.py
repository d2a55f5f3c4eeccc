"""A live camera: frames late, lost, frozen, dropped, wrongly stamped; no test waits."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from onboard_flying import Film, Kept, Live, filmed, room_localizer, run
from onboard_tools import Clock
from patience import eventually

from trexton.onboard.loop import Onboard
from trexton.onboard.sinks import Guard, Sink
from trexton.onboard.sources import CameraLost, Frame
from trexton.onboard.tally import Tally


@pytest.fixture
def film() -> list[np.ndarray]:
    return filmed()


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

    def test_a_slow_frame_is_late_and_older_ones_are_dropped(self, film):
        flight, localizer = Script(rate=50), room_localizer()
        begun, filmed, quick = threading.Event(), threading.Event(), localizer.step

        def slow_once(picture, **known):
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
        assert tally["late"] >= 1 and summary["faults"]["late"] == tally["late"]
        assert max(fix.latency for fix in fixes) == pytest.approx(0.5)
        assert summary["latency_s"]["longest"] == pytest.approx(0.5)

    def test_missed_frames_are_predicted_over(self, film):
        flight, localizer = Script(), room_localizer()
        seen, step = [], localizer.filter.step
        localizer.filter.step = lambda frame: (seen.append(frame is not None), step(frame))
        flight.run(
            [*flight.seen(film[0]), *flight.seen(film[1]), *flight.seen(film[2], 0.4)], localizer
        )
        assert seen.count(True) == 3
        assert seen.count(False) == 4  # 0.4 s are five periods of the map

    @pytest.mark.parametrize(("period", "steps"), [(0.11, 16), (0.12, 18), (0.04, 12)])
    def test_the_filter_keeps_time_with_a_camera_of_another_rate(self, film, period, steps):
        """What is left of a period at one frame counts at a later one; a frame is a step."""
        flight, localizer = Script(rate=50), room_localizer()
        told, step = [], localizer.filter.step
        localizer.filter.step = lambda seen: (told.append(seen and seen.time), step(seen))
        _, fixes, *_ = flight.run(
            [each for picture in film[:12] for each in flight.seen(picture, period)], localizer
        )
        assert abs(len(told) - steps) <= 1
        assert [time for time in told if time is not None] == [f.time for f in fixes if f.observed]

    def test_jumping_capture_stamps_never_reach_a_sink(self, film):
        jumps = iter([0.0, 0.0, 1e6, -1e6, 3e8, np.nan, 0.0, 0.0])
        flight = Script(clock=time.monotonic)
        _, fixes, tally, _ = flight.run(
            [step for picture in film[:8] for step in flight.seen(picture)],
            source_clock=lambda: time.monotonic() + next(jumps),
        )
        stamps = np.array([fix.time for fix in fixes])
        assert (np.diff(stamps) > 0).all()
        assert abs(stamps - time.monotonic()).max() < 600
        assert tally["clock"] == 4

    @pytest.mark.parametrize("offset", [0.0, 0.45, 1e6, -1e6])
    def test_the_delay_that_is_given_counts_on_whatever_clock_a_camera_stamps(
        self, film, offset, monkeypatch
    ):
        """Positions were stamped that much too late, where the camera's clock was another."""
        monkeypatch.setattr(Live, "delay", 0.2)
        flight = Script()
        steps = [step for picture in film[:4] for step in flight.seen(picture)]
        source, fixes, *_ = flight.run(steps, source_clock=lambda: flight.clock() + offset)
        late = [fix.captured - 0.08 * n for n, fix in enumerate(f for f in fixes if f.observed)]
        np.testing.assert_allclose(late, late[0], atol=1e-6)
        assert late[0] == pytest.approx(Clock()() + 0.08 - 0.2, abs=1e-6)

    def test_a_long_stall_is_counted_once(self, film):
        """What was left over of a minute counted again at every prediction."""
        flight = Script()

        def caught_up():
            assert eventually(lambda: flight.kept.fixes[-1].time >= flight.clock() - 0.2)

        _, fixes, tally, _ = flight.run([*flight.seen(film[0]), flight.later(60.0), caught_up])
        assert 745 <= tally["gap"] <= 750  # periods of 0.08 s
        assert not any(fix.usable for fix in fixes)

    def test_frames_at_fault_at_a_quick_rate_keep_time(self, film):
        """Each counted as a period: then nothing was reported for as long as they were ahead."""
        flight, dark = Script(rate=50), np.full((96, 128, 3), 5, np.uint8)
        covered = [step for _ in range(40) for step in flight.seen(dark, 0.04)]
        _, fixes, *_ = flight.run([*flight.seen(film[0]), *covered, flight.blind])
        assert fixes[-1].fault == "gap" and 0 <= flight.clock() - fixes[-1].time <= 0.16

    def test_a_source_may_stamp_by_numpy(self, film):
        flight = Script()
        _, fixes, *_ = flight.run(
            [step for picture in film[:3] for step in flight.seen(picture)],
            source_clock=lambda: np.float64(flight.clock()),
        )
        assert [type(fix.time) for fix in fixes] == [float] * 3
        assert {type(fix.stale) for fix in fixes} == {bool}

    def test_time_never_runs_backwards_after_a_stall(self, film):
        """A frame that was held up comes after predictions for later moments: what is written goes
        on, what an autopilot is told is the moment of the capture."""
        flight = Script()
        held_up = Frame(flight.clock() + 0.24, film[2])
        steps = [*flight.seen(film[0]), *flight.seen(film[1]), *[flight.blind] * 3, held_up]
        _, fixes, *_ = flight.run(steps)
        assert (np.diff([fix.time for fix in fixes]) > 0).all() and not fixes[-2].observed
        late = fixes[-1]
        assert late.observed and late.time - late.captured > 0.2
        assert late.captured == pytest.approx(held_up.time)

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


def test_a_step_that_takes_long_makes_a_stale_fix(film):
    """Age counts from capture to report: a stamp compared with itself is always fresh."""
    localizer = room_localizer()
    clock, quick = Clock(), localizer.step

    def slow(picture, **known):
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
