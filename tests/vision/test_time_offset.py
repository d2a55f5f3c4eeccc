"""How late frames are beside a yaw that was measured, by how they turn."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import cv2
import numpy as np
import pytest
from PIL import Image

from trexton.base.errors import ImageError
from trexton.flights.check import check_flight, repair_flight
from trexton.flights.flight import Flight
from trexton.flights.folder import read_flight
from trexton.flights.motion import seen_motion, turns
from trexton.flights.plausibility import warnings
from trexton.flights.writing import write_flight
from trexton.simulator.floor import Floor
from trexton.simulator.recording import record_flight
from trexton.simulator.sensor import Effects
from trexton.simulator.simulator import Simulator
from trexton.vision.camera import Camera
from trexton.vision.images import read_image
from trexton.vision.time_offset import read_small, small, time_offset

PERIOD = 0.08


@cache
def turning(yaw: float = 0.2, frames: int = 75):
    """Frames of a vehicle that hovers and turns by about `yaw` radians to and fro, and its yaw."""
    room = Simulator(
        Floor.painted("hall", 4), camera=Camera(320, 240, 260.0),
        effects=Effects(yaw=yaw), rng=np.random.default_rng(2),
    )  # fmt: skip
    pictures, measured = [], []
    for _ in range(frames):
        state = room.step(np.array([2.5, 2.5]))
        pictures.append(room.render())
        measured.append(state.attitude[2])
    return pictures, np.array(measured)


@pytest.fixture(scope="module")
def flown():
    pictures, measured = turning()
    turned = turns(seen_motion(small(each) for each in pictures))
    return turned, measured, PERIOD * np.arange(len(measured))


def test_frames_show_how_far_they_turned():
    pictures, measured = (each[:30] for each in turning())
    found = turns(seen_motion(small(each) for each in pictures))
    assert np.isnan(found[0])
    np.testing.assert_allclose(found[1:], np.diff(measured), atol=0.01)


@pytest.mark.parametrize("late", [-0.1, 0.0, 0.04, 0.25, 0.5])
def test_the_offset_is_found(flown, late):
    turned, measured, time = flown
    rng = np.random.default_rng(3)
    noisy = np.angle(np.exp(1j * (measured + 3.0 + 0.005 * rng.standard_normal(len(measured)))))
    found = time_offset(time + late, turned, time, noisy)
    assert found.sure and not found.mirrored
    assert abs(found.seconds - late) < max(0.02, 3 * found.sigma)
    assert found.noticeable == (abs(late) > 0.05)


def test_a_yaw_that_is_measured_more_often_than_frames_come(flown):
    turned, measured, time = flown
    often = np.linspace(time[0], time[-1], 700)
    found = time_offset(time[::3] + 0.2, _added(turned, 3), often, np.interp(often, time, measured))
    assert found.sure and abs(found.seconds - 0.2) < 0.03


def _added(turned: np.ndarray, several: int) -> np.ndarray:
    """What every `several`-th frame turned since the one that was kept before."""
    sums = np.add.reduceat(np.nan_to_num(turned[1:]), np.arange(0, len(turned) - 1, several))
    return np.concatenate([[np.nan], sums])[: len(turned[::several])]


def test_a_picture_that_is_mirrored_turns_the_other_way():
    pictures, measured = turning()
    mirrored = (small(np.ascontiguousarray(each[:, ::-1])) for each in pictures)
    turned = turns(seen_motion(mirrored))
    found = time_offset(PERIOD * np.arange(75), turned, PERIOD * np.arange(75), measured)
    assert found.sure and found.mirrored


@pytest.mark.parametrize(
    ("picture", "yaw"),
    [(np.full((120, 160), 90, np.uint8), np.linspace(0, 1, 75)), (None, np.zeros(75))],
)
def test_what_shows_nothing_is_not_sure(picture, yaw):
    frames = [picture] * 75 if picture is not None else (small(each) for each in turning(0.0)[0])
    time = PERIOD * np.arange(75)
    found = time_offset(time, turns(seen_motion(frames)), time, yaw)
    assert found is None or not found.sure


@pytest.mark.parametrize("frames_a_second", [5.0, 12.5, 30.0])
@pytest.mark.parametrize("yaw", ["steady", "to and fro"])
def test_noise_of_the_yaw_is_no_offset(frames_a_second, yaw):
    """A vehicle that turns steadily, as on a circle, turns alike at every offset."""
    rng, time = np.random.default_rng(4), np.arange(0, 12, 1 / frames_a_second)
    wrong = 0
    for phase in np.linspace(0, 6, 40):
        true = 0.4 * time if yaw == "steady" else 0.1 * np.sin(1.5 * time + phase)
        turned = np.diff(true, prepend=np.nan) + 0.001 * rng.standard_normal(len(time))
        found = time_offset(time, turned, time, true + 0.01 * rng.standard_normal(len(time)))
        wrong += found.sure and (found.mirrored or found.noticeable)
    assert wrong < 2


def test_too_little_is_nothing(flown):
    turned, measured, time = flown
    assert time_offset(time[:10], turned[:10], time, measured) is None
    assert time_offset(time, turned, time[:1], measured[:1]) is None
    assert time_offset(time + 100, turned, time, measured) is None
    assert time_offset([], [], [], []) is None
    stalled = np.append(0.02 * np.arange(13), 1.3)  # a burst of frames that a window holds all of
    assert time_offset(stalled, np.zeros(14), stalled, np.linspace(0, 1, 14)) is None
    assert time_offset(1e9 * time, turned, 1e9 * time, measured) is None


def test_frames_of_any_size_are_looked_at():
    rng = np.random.default_rng(1)
    sizes = [(1, 1), (2, 9), (12, 16), (30, 20), (12, 16), (12, 16)]
    frames = [rng.integers(0, 256, size, np.uint8) for size in sizes]
    turned = turns(seen_motion(frames))
    assert turned.shape == (6,) and np.isnan(turned[:2]).all()
    assert time_offset([], turns(seen_motion([])), [], []) is None


@pytest.fixture(scope="module")
def flight(tmp_path_factory) -> Flight:
    """One that turns."""
    return record_flight(
        tmp_path_factory.mktemp("turning") / "flight", frames=100, camera=Camera(160, 120, 130.0),
        pattern="waypoints", effects=Effects(yaw=0.2),
    )  # fmt: skip


@pytest.mark.parametrize(("turned", "named"), [(0.5, True), (0.0, False)])
def test_a_yaw_that_never_changes_while_the_pictures_turn_is_named(tmp_path, turned, named):
    """As of a column that nobody filled; a vehicle may also hold its heading."""
    flown = record_flight(
        tmp_path / "flight", frames=60, camera=Camera(160, 120, 130.0), pattern="waypoints",
        effects=Effects(yaw=turned),
    )  # fmt: skip
    held = flown.attitude * (1, 1, 0) + (0, 0, 1.5)
    said = [each for each in warnings(replace(flown, attitude=held)) if "never changes" in each]
    assert len(said) == named
    assert not [each for each in warnings(flown) if "never changes" in each]


@pytest.mark.parametrize("what", ["late", "clockwise", "as it is"])
def test_a_recorded_flight_whose_clocks_differ_is_named(flight, tmp_path, what):
    shifted = flight
    if what == "late":
        before = flight.time + 0.24
        columns = (*flight.position.T, flight.attitude[:, 2])
        x, y, yaw = (np.interp(before, flight.time, each) for each in columns)
        shifted = replace(
            flight,
            position=np.column_stack([x, y]),
            attitude=np.column_stack([flight.attitude[:, :2], yaw]),
        )
    elif what == "clockwise":
        shifted = replace(flight, attitude=flight.attitude * (1, 1, -1))
    path = write_flight(shifted, tmp_path / what)
    warnings = [each for each in check_flight(path).warnings if "the pictures" in each]
    assert len(warnings) == (what != "as it is")
    if what == "late":
        assert "turn 0.2" in warnings[0] and "--offset 0.2" in warnings[0]
    if what == "clockwise":
        assert "counted clockwise" in warnings[0]
    done = repair_flight(path, tmp_path / "mended")
    mended = read_flight(tmp_path / "mended")
    assert ("not repaired" in " ".join(done)) == (what == "late")
    if what == "clockwise":
        np.testing.assert_allclose(mended.attitude, flight.attitude)


@pytest.mark.parametrize(
    ("name", "size"),
    [("a.jpg", (640, 480)), ("a.png", (640, 480)), ("a.jpg", (752, 480)), ("a.jpg", (200, 150))],
)
def test_a_file_read_small_is_that_image_made_small(tmp_path, name, size):
    picture = cv2.resize(np.random.default_rng(1).integers(0, 255, (30, 40, 3), np.uint8), size)
    turned = Image.Exif()
    turned[0x0112] = 6  # taken with the camera on its side
    Image.fromarray(picture).save(tmp_path / name, exif=turned)
    whole, seen = small(read_image(tmp_path / name)), read_small(tmp_path / name)
    assert whole.shape[0] > whole.shape[1] and seen.shape[0] > seen.shape[1]
    alike = np.corrcoef(cv2.resize(seen, whole.shape[::-1]).ravel(), whole.ravel())[0, 1]
    assert alike > 0.99
    file = tmp_path / "cut.jpg"
    file.write_bytes((tmp_path / name).read_bytes()[:-500])
    with pytest.raises(ImageError):
        read_small(file)
