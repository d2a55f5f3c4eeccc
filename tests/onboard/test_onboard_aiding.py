"""Attitude and height that came beside a frame: gathered, checked for their age, and worth it."""

from __future__ import annotations

import math
import re
import threading
from dataclasses import replace

import numpy as np
import pytest
from onboard_flying import Kept, run
from onboard_tools import AREA, CAMERA, Clock, colourful_floor
from small_survey import AREA as SURVEYED
from small_survey import look, path

from trexton.flights.aiding import Aiding
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.training import train_map
from trexton.onboard.intake import Aids
from trexton.onboard.sinks import Guard
from trexton.onboard.sources import Frame, recorded
from trexton.onboard.sources.recorded import FlightSource
from trexton.onboard.tally import Tally
from trexton.simulator.recording import record_flight

FULL = Aiding(0.1, -0.2, 0.3, 1.5, np.array([0.4, 0.5]), 10.0, 10.0, 10.0)


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    folder, floor = tmp_path_factory.mktemp("flights"), colourful_floor()
    common = {"camera": CAMERA, "floor": floor}
    return (
        record_flight(folder / "train", frames=110, speed=1.0, every=3, **common),
        record_flight(folder / "test", pattern="waypoints", frames=80, **common),
    )


class Autopilot(Kept):
    """An output that knows something of the vehicle."""

    def __init__(self, known: Aiding):
        super().__init__()
        self.known = known

    def aiding(self, time):
        return self.known


def aids(wanted: str, *known: Aiding) -> Aids:
    return Aids(wanted, [Guard(Autopilot(each), Tally()) for each in known])


@pytest.fixture(scope="module")
def fine(flights) -> TextonMap:
    return train_map(flights[0], method="fine", n_textons=6, rng=np.random.default_rng(1))


def test_a_replay_is_better_for_what_was_recorded_beside_it(fine, flights):
    texton_map, test = fine, flights[1]
    part, rng = texton_map.parts["filter"], np.random.default_rng(3)
    test = replace(  # as far off as an autopilot may be
        test,
        attitude=test.attitude + part.attitude_sigma * rng.standard_normal((80, 3)),
        height=test.height + part.height_sigma * rng.standard_normal(80),
    )
    errors = {}
    for wanted in ("none", "tilt"):
        localizer = Localizer(texton_map, rng=np.random.default_rng(2))
        fixes, _, _ = run(localizer, FlightSource(test), aiding=wanted)
        error = np.array([fix.position for fix in fixes]) - test.position
        errors[wanted] = float(np.hypot(*error[30:].T).mean())
    assert errors["tilt"] < 0.85 * errors["none"]


@pytest.mark.parametrize("degrees", [0.0, 4.0])
def test_a_camera_that_looks_askew_is_learned_counted_and_said_once(fine, flights, degrees, capsys):
    test = flights[1]
    askew = replace(test, attitude=test.attitude + np.radians([degrees, 0.0, 0.0]))
    localizer = Localizer(fine, rng=np.random.default_rng(2))
    fixes, tally, _ = run(localizer, FlightSource(askew), aiding="tilt")
    error = np.array([fix.position for fix in fixes]) - test.position
    assert np.hypot(*error[40:].T).mean() < 0.02
    said = re.findall(
        r"attitude contradicted by the frames, roll_off_deg (\S+),", capsys.readouterr().err
    )
    assert len(said) == (degrees > 0) and all(abs(float(each) - degrees) < 1.5 for each in said)
    assert (tally["attitude"] > 30) if degrees else (tally["attitude"] == 0)


def test_what_is_told_is_what_was_asked_for_and_only_if_it_is_of_that_moment():
    frame = Frame(10.0, None)
    assert aids("none", FULL).of(frame, 10.0) is None
    tilt = aids("tilt", FULL).of(frame, 10.0)
    assert (tilt.roll, tilt.pitch, tilt.yaw, tilt.height) == (0.1, -0.2, None, 1.5)
    assert tilt.velocity is None
    everything = aids("all", FULL).of(frame, 10.0)
    assert everything.yaw == 0.3 and everything.velocity is FULL.velocity
    late = aids("all", FULL).of(frame, 10.2)  # a tilt of then is no tilt of now
    assert late.roll is None and late.yaw is None and late.height == 1.5
    assert aids("all", FULL).of(frame, 10.5) is None and aids("all", FULL).of(frame, 9.5) is None
    unstamped = replace(FULL, attitude_time=None, height_time=None, velocity_time=None)
    assert aids("all", unstamped).of(frame, 10.0) is None
    broken = replace(FULL, roll=float("nan"), height=float("inf"))
    told = aids("all", broken).of(frame, 10.0)
    assert told.roll is None and told.height is None and told.pitch == -0.2
    assert aids("all").of(frame, 10.0) is None


def test_what_is_not_finite_is_not_known():
    """A yaw of NaN, given from Python, turned round for ever."""
    known = Aiding(yaw=np.nan, roll=0.1, height=np.inf, attitude_time=1.0, height_time=1.0)
    assert (known.yaw, known.roll, known.height) == (None, 0.1, None)
    assert known.at(1.0).height_time is None and known.at(1.0).attitude_time == 1.0


def test_the_frame_is_believed_before_an_autopilot_which_adds_what_is_missing():
    own = Aiding(height=0.9, height_time=3.0)
    told = aids("all", FULL, replace(FULL, roll=9.0)).of(Frame(3.0, None, aiding=own), 10.0)
    assert told.height == 0.9 and told.roll == 0.1 and told.height_time == 10.0
    empty = Aiding(math.nan, math.nan, math.nan, attitude_time=3.0)  # a row without its attitude
    assert aids("all", FULL).of(Frame(3.0, None, aiding=empty), 10.0).roll == 0.1


def test_the_columns_of_a_flight_come_with_its_frames_also_when_it_is_paced(flights, monkeypatch):
    test = flights[1]
    frame = FlightSource(test).read()
    assert (frame.aiding.roll, frame.aiding.pitch, frame.aiding.yaw) == tuple(test.attitude[0])
    assert frame.aiding.height == test.height[0]
    monkeypatch.setattr(recorded, "time", Clock(500.0))
    paced = FlightSource(test, pace="stamps")
    paced.read()
    late = paced.read()
    assert late.time > 500 and late.aiding.at(late.time).roll == test.attitude[1, 0]
    bare = FlightSource(replace(test, attitude=None, height=None)).read().aiding
    assert bare.roll is None and bare.height is None and test.area == AREA


def late_by(source, seconds):
    source.delay = seconds
    return source


def test_a_camera_whose_delay_is_known_is_localized_by_the_attitude_of_its_exposure(fine, flights):
    test, late = flights[1], 0.24
    stamped = replace(test, time=test.time + late, attitude=None, height=None)

    class Told(Kept):
        def aiding(self, time):
            row = int(np.abs(test.time - time).argmin())
            return replace(test.aiding(row), yaw=None)

    errors = {}
    for known in (0.0, late):
        localizer = Localizer(fine, rng=np.random.default_rng(2))
        source = late_by(FlightSource(stamped), known)
        fixes, _, _ = run(localizer, source, sink=Told(), aiding="tilt")
        error = np.array([fix.position for fix in fixes]) - test.position
        errors[known] = float(np.hypot(*error[30:].T).mean())
        assert fixes[0].time == pytest.approx(test.time[0] + late - known)
    assert errors[late] < 0.8 * errors[0.0]


def test_what_a_camera_is_late_by_is_no_deadline_that_the_computer_missed(fine, flights):
    source = late_by(FlightSource(flights[1].select(slice(0, 30)), pace="stamps"), 12.0)
    localizer, stop = Localizer(fine, rng=np.random.default_rng(2)), threading.Event()

    class One(Kept):
        def write(self, fix):
            stop.set()

    # A rate that a busy computer does not miss; it would wait as long for a second frame.
    _, tally, summary = run(localizer, source, stop, One(), rate=0.1)
    assert tally["frames"] and not tally["late"] and summary["latency_s"]["median"] > 12.0


def shown(name, count, start, seed) -> Flight:
    places, time = path(count, start)
    seen = look(places, np.random.default_rng(seed))
    return Flight(name, np.arange(count), time, places, SURVEYED, histograms=seen)


@pytest.fixture(scope="module")
def surveyed() -> TextonMap:
    return train_map(shown("survey", 500, 0.0, 2), method="field", rng=np.random.default_rng(1))


@pytest.mark.parametrize("drift", [0.0, 0.5])
def test_a_velocity_that_the_frames_contradict_is_counted_and_said_once(surveyed, drift, capsys):
    later = shown("later", 120, 51.3, 9)
    velocity = np.gradient(later.position, later.time, axis=0) + [drift, 0.0]

    class Told(Kept):
        def aiding(self, time):
            row = int(np.abs(later.time - time).argmin())
            return Aiding(velocity=velocity[row], velocity_time=time)

    localizer = Localizer(surveyed, rng=np.random.default_rng(2))
    fixes, tally, _ = run(localizer, FlightSource(later), sink=Told(), aiding="all")
    said = capsys.readouterr().err.count("velocity contradicted by the frames, off_m_s 0.")
    assert len(fixes) == 120
    assert said == (1 if drift else 0)
    assert (tally["velocity"] > 60) if drift else (tally["velocity"] == 0)
