"""Frames under another light, at another heading: what the field makes of them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from trexton.field.appearance import Tracked
from trexton.flights.aiding import Aiding
from trexton.localization.localizer import Localizer
from trexton.localization.training import train_map, with_choices
from trexton.simulator.floor import Floor, Light
from trexton.simulator.recording import Plan, random_waypoints, record_flight
from trexton.simulator.simulator import Simulator
from trexton.vision.camera import Camera
from trexton.vision.correction import corrected_frame, corrected_patches
from trexton.vision.images import gather_patches, sample_positions

CAMERA = Camera(width=240, height=180, focal=195.0)


class Turned(Simulator):
    """A vehicle that flies at another heading than the survey."""

    heading = 0.0

    @property
    def state(self):
        state = Simulator.state.fget(self)
        return replace(state, attitude=state.attitude + [0.0, 0.0, self.heading])


@pytest.fixture(scope="module")
def surveyed(tmp_path_factory):
    floor = Floor.painted("hall", 4)  # as others have it
    flight = record_flight(
        tmp_path_factory.mktemp("appearance") / "survey",
        pattern="survey", frames=280, seed=1, floor=floor, every=2, camera=CAMERA,
    )  # fmt: skip
    return floor, train_map(flight, method="field", n_textons=12, rng=np.random.default_rng(0))


AS_SURVEYED = Light()


def flown(
    surveyed, light=AS_SURVEYED, heading=0.0, frames=70, rate=0.0, yaw_known=False, turned=None,
    samples=200, **choices,
):  # fmt: skip
    """Errors in metres, whether lost, and the filter of the appearance; the velocity is given if it
    is `turned` by so many radians.
    """
    floor, texton_map = surveyed
    ways, rng = np.random.default_rng(5).spawn(2)
    plan = Plan(random_waypoints(floor.area, ways))
    simulator = Turned(floor, camera=CAMERA, light=light, start=plan.start, speed=0.6, rng=rng)
    simulator.heading = heading
    chosen = with_choices(texton_map, choices)
    localizer = Localizer(chosen, samples=samples, rng=np.random.default_rng(1))
    errors, lost = [], []
    for _ in range(frames):
        before = simulator.state.position[:2]
        for _ in range(2):
            simulator.heading += rate
            simulator.step(plan.goal(simulator.vehicle.state.position))
        aiding = Aiding(yaw=float(simulator.state.attitude[2])) if yaw_known else None
        if turned is not None:
            x, y = (simulator.state.position[:2] - before) / texton_map.period_s
            cosine, sine = np.cos(turned), np.sin(turned)
            aiding = Aiding(velocity=np.array([cosine * x - sine * y, sine * x + cosine * y]))
        estimate = localizer.step(simulator.render(), aiding=aiding)
        errors.append(np.hypot(*(estimate.position - simulator.state.position[:2])))
        lost.append(estimate.lost)
    return np.array(errors), np.array(lost), localizer._appearance


def test_another_light_costs_little(surveyed):
    as_surveyed, _, _ = flown(surveyed, frames=60)
    light = Light(gain=0.8, warmth=0.05)
    blind, _, off = flown(surveyed, light, frames=60, appearance="none")
    errors, lost, appearance = flown(surveyed, light, frames=60)
    assert off is None
    assert np.median(errors[10:]) < 1.5 * np.median(as_surveyed[10:]) < np.median(blind[10:])
    assert np.exp(appearance.mean[0]) == pytest.approx(0.8, abs=0.1)
    assert lost[:8].all() and not lost[40:].any()  # until the light is known for a second


def test_any_heading_at_the_start_is_noticed(surveyed):
    heading = np.radians(200)
    blind, _, _ = flown(surveyed, heading=heading, frames=100, appearance="none")
    errors, _, appearance = flown(surveyed, heading=heading, frames=100)
    assert np.median(errors[10:]) < 0.3 < np.median(blind[10:])
    off = (appearance.mean[3] - heading + np.pi) % (2 * np.pi) - np.pi
    assert abs(off) < np.radians(25)


def test_a_given_yaw_is_used_while_the_vehicle_turns(surveyed):
    turning = {"rate": np.radians(120) / 140, "frames": 50}
    blind, _, _ = flown(surveyed, **turning, appearance="none")
    errors, lost, _ = flown(surveyed, **turning, yaw_known=True)
    assert 1.5 * np.median(errors[10:]) < np.median(blind[10:])
    assert not lost[20:].any()


def test_a_search_takes_a_given_yaw_as_it_is(surveyed):
    """And not the turn since the frame before beside it, which is in it already."""
    floor, texton_map = surveyed
    simulator = Simulator(floor, camera=CAMERA, rng=np.random.default_rng(2))
    frame, turn = simulator.render(), np.zeros(5)
    turn[3] = 0.1
    tracked = texton_map.parts["appearance"]
    appearance = tracked.open(texton_map, np.random.default_rng(0))
    appearance._search()
    for each in (frame, corrected_frame(frame, turn, np.zeros(4))):
        appearance.velocity(each, 0.08)
        appearance.update(each, float(tracked.survey_yaw) + 0.5)
        assert appearance.mean[3] == pytest.approx(0.5, abs=1e-9)
    assert abs(appearance._moved[0]) > 0.05  # it did turn


def test_a_turn_is_followed_without_a_yaw(surveyed):
    """By what the frames show of it; before, it was followed only once it was lost."""
    errors, lost, appearance = flown(surveyed, rate=np.radians(60) / 140)
    blind, _, _ = flown(surveyed, rate=np.radians(60) / 140, appearance="none")
    assert appearance.mean[3] == pytest.approx(np.radians(60), abs=np.radians(10))
    assert np.median(errors[10:]) < np.median(blind[10:])
    assert lost[20:].mean() <= 0.1  # where it is off by up to 60 cm for a second


def test_frames_of_another_floor_are_not_silently_wrong(surveyed, tmp_path):
    _, texton_map = surveyed
    errors, lost, _ = flown((Floor.painted(), texton_map), frames=40)
    assert ((errors > 0.3) & ~lost).mean() <= 0.05


@pytest.fixture(scope="module")
def alike(tmp_path_factory):
    """Two prints, each laid four times."""
    floor = Floor.painted("repeats", 4002)
    flight = record_flight(
        tmp_path_factory.mktemp("alike") / "survey",
        pattern="survey", frames=280, seed=1, floor=floor, every=2, camera=CAMERA,
    )  # fmt: skip
    return floor, train_map(flight, method="field", rng=np.random.default_rng(0))


def test_a_given_velocity_does_not_stop_frames_from_being_weighed_together(alike):
    alone, lost_alone, _ = flown(alike, samples=400)
    errors, lost, _ = flown(alike, samples=400, turned=0.0)
    assert lost.sum() <= lost_alone.sum() + 2 < 50
    assert errors.mean() < 1.1 * alone.mean()


@pytest.mark.parametrize(("turned", "frames"), [(20, 100), (180, 60)])
def test_a_turned_velocity_is_not_silently_wrong(alike, turned, frames):
    """Frames show what the compass makes wrong, and move what they say together."""
    errors, lost, _ = flown(alike, samples=400, frames=frames, turned=np.radians(turned))
    assert not ((errors > 0.5) & ~lost).any()  # as it would be at another place
    assert ((errors > 0.3) & ~lost).mean() <= 0.06  # drawn along, until they do


def test_equal_seeds_give_equal_flights(surveyed):
    first, second = (flown(surveyed, Light(gain=0.9), frames=15)[0] for _ in range(2))
    assert (first == second).all()


def test_a_frame_as_surveyed_is_not_touched(rng):
    frame = rng.integers(0, 256, (40, 60, 3), dtype=np.uint8)
    state, level = np.zeros(5), np.zeros(4)
    assert corrected_frame(frame, state, level) is frame
    positions = sample_positions(frame.shape, 6, 20, rng)
    patches = corrected_patches(frame, positions, 6, state, level)
    assert (patches == gather_patches(frame, positions, 6)).all()


def test_patches_are_those_of_the_corrected_frame(rng):
    frame = np.repeat(np.repeat(rng.integers(60, 180, (10, 15, 3), dtype=np.uint8), 8, 0), 8, 1)
    state, levels = np.array([0.1, -0.02, 0.01, 0.4, 0.1]), np.array([0.0, -0.3, 0.2, 0.0])
    positions = sample_positions(frame.shape, 6, 50, rng)
    patches = corrected_patches(frame, positions, 6, state, levels).astype(int)
    whole = gather_patches(corrected_frame(frame, state, levels), positions, 6).astype(int)
    inner = np.abs(positions + 3 - [40, 60]).min(axis=1) > 3  # within one tile
    assert np.abs(patches - whole)[inner].max() <= 3  # remap and warp round positions differently


def test_histograms_show_no_light():
    from small_room import histogram_flight

    texton_map = train_map(histogram_flight("h"), method="field", rng=np.random.default_rng(0))
    assert texton_map.parts["appearance"].open(texton_map, np.random.default_rng(0)) is None
    assert isinstance(texton_map.parts["appearance"], Tracked)


def test_frames_in_half_the_time_show_twice_the_velocity(surveyed):
    """And a frame that did not come halves it, with a stamp or without."""
    floor, texton_map = surveyed
    period = texton_map.period_s
    simulator = Simulator(floor, camera=CAMERA, speed=0.6, rng=np.random.default_rng(2))
    pictures = []
    for _ in range(2):
        simulator.step(np.array([3.0, 3.0]))
        pictures.append(simulator.render())

    def velocity(first=None, second=None, missed=0):
        localizer = Localizer(texton_map, rng=np.random.default_rng(1))
        localizer.step(pictures[0], time=first)
        for _ in range(missed):
            localizer.step(None)
        return localizer.observation(pictures[1], time=second).velocity_seen

    usual = velocity()
    assert np.hypot(*usual) > 0.02
    assert velocity(5.0, 5.0 + period) == pytest.approx(usual, abs=0)
    assert velocity(5.0, 5.0 + period / 2) == pytest.approx(2 * usual)
    assert velocity(5.0, 5.0 + 2 * period) == pytest.approx(usual / 2)
    assert velocity(missed=1) == pytest.approx(usual / 2)
    alike = [velocity(5.0, stamp) for stamp in (5.0, 4.0)]  # no time passed, or a clock went back
    assert alike == [None, None]
