"""Pictures that move otherwise than the positions beside them are named, and no sound ones."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

from trexton.flights.check import check_flight
from trexton.flights.flight import Flight, area_around
from trexton.flights.frames import ImageFiles
from trexton.flights.importing import import_flight
from trexton.flights.motion import MOST, followed_rows, motion_doubts, repeats, seen_motion
from trexton.flights.plausibility import warnings
from trexton.vision.camera import Camera

SIZE, FOCAL, HEIGHT = (96, 72), 80.0, 1.0
SCALE = 200.0  # pixels of the floor a metre


@cache
def floor() -> np.ndarray:
    rough = np.random.default_rng(5).integers(0, 256, (120, 150), np.uint8)
    return cv2.resize(rough, (1500, 1200), interpolation=cv2.INTER_CUBIC)


def taken(x: float, y: float, yaw: float) -> np.ndarray:
    """The luma of the floor below, the top of the picture where the yaw points."""
    (width, height), across = SIZE, SCALE * HEIGHT / FOCAL
    cosine, sine = across * np.cos(yaw), across * np.sin(yaw)
    turn = np.array([[cosine, sine], [-sine, cosine]])
    middle = np.array([SCALE * x, 1200 - SCALE * y]) - turn @ ((width - 1) / 2, (height - 1) / 2)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(floor(), np.column_stack([turn, middle]), SIZE, flags=flags)


@cache
def flown(seed: int, frames: int = 80, straight: bool = False) -> tuple[Flight, list[np.ndarray]]:
    """A flight over the floor, and its pictures."""
    rng = np.random.default_rng(seed)
    time, phase = np.arange(frames) / 10, rng.uniform(0, 6, 4)
    x = 3.5 + 1.8 * np.sin(0.4 * time + phase[0]) + 0.2 * np.sin(1.7 * time)
    y = 3.0 + 1.5 * np.sin(0.6 * time + phase[1]) * np.cos(0.2 * time + phase[2])
    yaw = 0.9 * np.sin(0.6 * time + phase[3]) + 0.5 * np.sin(1.7 * time)
    if straight:
        x, y = 2 + 0.4 * time, 2 + 0.2 * time
    place = np.column_stack([x, y])
    pictures = [taken(*row) for row in zip(x, y, yaw, strict=True)]
    noise = rng.normal(0, 2, (frames, *pictures[0].shape))
    noisy = list(np.clip(np.array(pictures) + noise, 0, 255).astype(np.uint8))
    attitude = np.column_stack([np.zeros((frames, 2)), yaw])
    flight = Flight(
        "over a floor", np.arange(frames), time, place, area_around(place, 0.02, 0.01),
        height=np.full(frames, HEIGHT), attitude=attitude, camera=Camera(*SIZE, FOCAL),
        histograms=np.eye(frames),
    )  # fmt: skip
    return flight, noisy


@cache
def motion(seed: int, straight: bool = False) -> tuple[np.ndarray, ...]:
    return seen_motion(flown(seed, straight=straight)[1])


def said(flight: Flight, seen: tuple[np.ndarray, ...]) -> list[str]:
    return list(motion_doubts(flight, np.arange(len(flight)), seen))


@pytest.mark.parametrize("seed", range(4))
def test_nothing_is_said_of_sound_flights(seed):
    flight, pictures = flown(seed)
    rng = np.random.default_rng(seed)
    noisy = flight.position + rng.normal(0, 0.03, flight.position.shape)
    lost = np.where(rng.random((len(flight), 1)) < 0.2, np.nan, flight.position)
    for position in (flight.position, noisy, lost):
        assert said(replace(flight, position=position), motion(seed)) == []
    still = flight.position[:1] + rng.normal(0, 0.01, flight.position.shape)
    stood = seen_motion(pictures[:1] * len(flight))
    assert said(replace(flight, position=still), stood) == []
    apart = seen_motion(pictures[::8] * 8)  # nothing in common from one to the next
    assert said(replace(flight, position=flight.position[:, ::-1]), apart) == []


def turned(flight: Flight) -> Flight:
    return replace(flight, attitude=flight.attitude + (0, 0, np.pi / 2))


def exchanged(flight: Flight) -> Flight:
    return replace(flight, position=flight.position[:, ::-1])


DAMAGE = {
    "is x exchanged with y, or": exchanged,
    "counted the other way?": lambda f: replace(f, position=f.position * (-1, 1)),
    "are they of another flight": lambda f: replace(f, position=flown(9)[0].position),
    "order or clock?": lambda f: replace(f, position=f.position[:1] + 0 * f.position),
    "move -90 degrees anticlockwise of the yaw: is it counted from x": turned,
    "as if taken 1.0 m above the floor, not 3.3": lambda f: replace(f, height=f.height / 0.3048),
    "as if taken 2.0 m above the floor, not 1.0": lambda f: replace(
        f, camera=Camera(192, 144, 320.0)
    ),
}


@pytest.mark.parametrize("words", DAMAGE)
@pytest.mark.parametrize("seed", [0, 1])
def test_what_pictures_contradict_is_named(seed, words):
    flight, _ = flown(seed)
    (found,) = said(DAMAGE[words](flight), motion(seed))
    assert words in found


@pytest.mark.parametrize("seconds", [-0.7, 0.0, 0.5])
@pytest.mark.parametrize("seed", [0, 1])
def test_clocks_that_differ_are_named(seed, seconds):
    flight, _ = flown(seed)
    then = flight.time - seconds
    place = [np.interp(then, flight.time, each, np.nan, np.nan) for each in flight.position.T]
    found = said(replace(flight, position=np.column_stack(place)), motion(seed))
    assert len(found) == (seconds != 0)
    for words in found:
        offset = re.search(r"ahead of the other, --offset (-?[0-9.]+)\?", words)
        assert abs(float(offset[1]) + seconds) < 0.15


@pytest.mark.parametrize("damage", [turned, exchanged])
def test_a_straight_way_does_not_tell_a_mirror_from_a_turned_yaw(damage):
    flight, _ = flown(0, straight=True)
    seen = motion(0, straight=True)
    assert said(flight, seen) == []
    (found,) = said(damage(flight), seen)
    assert "of the yaw: is it counted from x, x exchanged with y, or the camera mounted" in found


def test_noise_of_gps_is_no_other_flight():
    flight, _ = flown(0)
    other = replace(flight, position=flown(9)[0].position, origin=(50.0, 4.0))
    assert said(other, motion(0)) == []


@pytest.mark.parametrize("stood", [0, 50, 400])
def test_frames_are_followed_where_the_vehicle_moves(stood):
    way = np.concatenate([np.zeros(stood), np.arange(300.0), np.full(200, 299.0)])
    place = np.column_stack([way, 2 * way])
    place[stood + 100] = np.nan
    flight = Flight(
        "a line", np.arange(len(way)), 0.1 * np.arange(len(way)), place,
        area_around(place[:2], 0.02, 0.01), histograms=np.eye(len(way)),
    )  # fmt: skip
    rows = followed_rows(flight)
    assert len(rows) == MOST and (np.diff(rows) == 1).all()
    assert stood - 1 <= rows[0] and rows[-1] <= stood + 300
    few = flight.select(slice(3))
    np.testing.assert_array_equal(followed_rows(few), np.arange(3))


def table(folder: Path, position: np.ndarray, pictures: list[np.ndarray]) -> Path:
    rows = ["t,x,y,image"]
    for row, (x, y) in enumerate(position.tolist()):
        cv2.imwrite(str(folder / f"{row:02}.png"), pictures[row])
        rows.append(f"{row / 10},{x},{y},{row:02}.png")
    (folder / "table.csv").write_text("\n".join(rows))
    return folder / "table.csv"


@pytest.mark.parametrize("mirrored", [False, True])
def test_the_check_names_pictures_that_are_mirrored(tmp_path, mirrored):
    flight, pictures = flown(1)
    pictures = [each[:, ::-1] if mirrored else each for each in pictures]
    brought, _ = import_flight(table(tmp_path, flight.position, pictures), tmp_path / "out")
    found = "\n".join(check_flight(tmp_path / "out").warnings)
    assert ("is x exchanged with y" in found) == mirrored
    assert ("is x exchanged with y" in "\n".join(warnings(brought))) == mirrored
    lost = np.where(np.arange(len(flight))[:, None] % 5, brought.position, 0.0)
    assert "is x exchanged" not in "\n".join(warnings(replace(brought, position=lost)))


def test_nothing_is_said_over_tiles_of_which_one_looks_like_the_next(tmp_path):
    flight, pictures = flown(0)
    tile = np.random.default_rng(1).integers(0, 256, (6, 8), np.uint8)
    tiles = np.tile(cv2.resize(tile, (24, 18), interpolation=cv2.INTER_CUBIC), (5, 16))
    tiled = [tiles[:72, 2 * row : 2 * row + 96] for row in range(len(flight))]
    assert np.mean([*map(repeats, tiled)]) > 0.9 and not np.any([*map(repeats, pictures)])
    still = np.column_stack([flight.position[:, 1], 0 * flight.time])  # they move along x
    for kind, seen in (("tiles", tiled), ("floor", pictures)):
        (tmp_path / kind).mkdir()
        brought, _ = import_flight(table(tmp_path / kind, still, seen), tmp_path / f"{kind}-flight")
        doubted = [each for each in warnings(brought) if "the pictures" in each]
        assert bool(doubted) == (kind == "floor")
        doubts = motion_doubts(brought, np.arange(len(brought)), seen_motion(seen))
        assert list(doubts) or kind == "floor"


def test_a_yaw_is_judged_where_the_vehicle_turned_on_the_spot(tmp_path):
    """It moves elsewhere, in a straight line: pictures were followed there alone."""
    frames, turned = 320, 100
    time = np.arange(frames) / 10
    yaw = np.where(time < turned / 10, 0.7 * np.sin(1.7 * time), 0.0)
    x = np.concatenate([np.full(turned, 1.5), np.linspace(1.5, 6, frames - turned)])
    pictures = [taken(*row) for row in zip(x, np.full(frames, 3.0), yaw, strict=True)]
    for row, picture in enumerate(pictures):
        cv2.imwrite(str(tmp_path / f"{row:03}.png"), picture)
    files = ImageFiles(tuple(sorted(tmp_path.glob("*.png"))))
    place = np.column_stack([x, np.full(frames, 3.0)])
    flight = Flight(
        "on the spot", np.arange(frames), time, place, area_around(place, 0.02, 0.1),
        attitude=np.column_stack([np.zeros((frames, 2)), yaw]), frames=files,
    )  # fmt: skip
    negated = replace(flight, attitude=-flight.attitude)
    assert not any("the yaw" in each for each in warnings(flight))
    assert any("against the yaw" in each for each in warnings(negated))
