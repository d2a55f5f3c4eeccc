"""Method ``fine``: trained from a flight, stored in the map, flown by the localizer."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from scipy.stats import t

from trexton.base.errors import MapError, ParameterError
from trexton.flights.aiding import Aiding
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.map_files import load_map, save_map
from trexton.localization.training import train_map, with_parts
from trexton.registration.filter import Registration
from trexton.simulator.floor import Floor, Light
from trexton.simulator.recording import record_flight
from trexton.simulator.sensor import Effects
from trexton.vision.camera import Camera

CAMERA = Camera(160, 120, 130.0)


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    folder = tmp_path_factory.mktemp("flights")
    common = {"camera": CAMERA, "effects": Effects().without("jpeg")}
    train = record_flight(folder / "train", frames=110, speed=1.0, every=3, **common)
    test = record_flight(folder / "test", pattern="waypoints", frames=30, **common)
    return train, test


@pytest.fixture(scope="module")
def fine(flights) -> TextonMap:
    return train_map(flights[0], method="fine", n_textons=6, rng=np.random.default_rng(1))


def flown(texton_map: TextonMap, flight, **options):
    localizer = Localizer(texton_map, rng=np.random.default_rng(2), **options)
    estimates = []
    for row in range(len(flight)):
        roll, pitch, yaw = flight.attitude[row]
        aiding = Aiding(roll=roll, pitch=pitch, yaw=yaw, height=flight.height[row])
        estimates.append(localizer.step(flight.image(row), aiding=aiding))
    return estimates


@pytest.fixture(scope="module")
def estimates(fine, flights):
    """Of every frame of the later flight."""
    return flown(fine, flights[1])


def test_the_map_flies_as_it_was_trained_and_as_it_was_read_back(
    fine, flights, estimates, tmp_path
):
    test = flights[1]
    error = np.hypot(*(np.array([each.position for each in estimates]) - test.position).T)
    assert error[5:].max() < 0.04 and error[5:].mean() < 0.015
    assert not any(each.lost for each in estimates[5:])
    last = estimates[-1]
    assert last.measurement is not None and (last.measurement.position == last.position).all()
    again = flown(load_map(save_map(fine, tmp_path / "map.npz")), test)
    assert all((a.position == b.position).all() for a, b in zip(estimates, again, strict=True))


def test_regions_hold_about_what_they_claim(flights, estimates):
    test = flights[1]
    distances = [
        (error := each.position - place) @ np.linalg.solve(each.covariance, error)
        for each, place in zip(estimates[5:], test.position[5:], strict=True)
    ]
    assert 0.6 < np.mean(np.array(distances) < 4.605) <= 1
    assert 0.1 < np.mean(distances) / 2 < 3


def nees_over(floor: Floor, seed: int, folder) -> list[float]:
    """Of the last frame of each of six flights over a floor whose picture, camera and attitude are
    as the method takes them.
    """
    common = {"camera": CAMERA, "effects": Effects().without("jpeg"), "floor": floor}
    train = record_flight(folder / "train", frames=110, speed=1.0, every=3, seed=seed, **common)
    texton_map = train_map(train, method="fine", n_textons=6, rng=np.random.default_rng(1))
    nees = []
    for number in range(6):
        where, later = folder / str(number), 100 + 10 * seed + number
        test = record_flight(
            where, pattern="waypoints", frames=12, seed=later, light=Light(), **common
        )
        noise = np.random.default_rng(number).normal(0, Registration().attitude_sigma, (12, 3))
        test = replace(test, attitude=test.attitude + noise)
        last = flown(texton_map, test)[-1]
        offset = last.position - test.position[-1]
        assert not last.lost
        nees.append(offset @ np.linalg.solve(last.covariance, offset))
    return nees


@pytest.mark.slow
def test_nees_is_in_its_band_where_the_model_is_true(tmp_path):
    """Floors are the units: flights over one share what was learned of it. What is claimed may be
    half as wide again as the errors, and a twentieth narrower.
    """
    layouts = ("hall", "moved")
    floors = [Floor.painted(layouts[number % 2], 400 + number) for number in range(8)]
    nees = np.array(
        [nees_over(floor, seed, tmp_path / str(seed)) for seed, floor in enumerate(floors, 1)]
    ).mean(axis=1)
    low, high = t.interval(0.99, len(nees) - 1, nees.mean(), nees.std(ddof=1) / np.sqrt(len(nees)))
    least, most = 2 / 1.5**2, 2 * 1.05**2
    assert low < most and least < high, nees
    assert not 4 * low < most and not least < high / 4, nees  # deviations half, or twice as large


def test_it_says_how_fast_the_vehicle_goes(fine, flights):
    test = flights[1]
    localizer = Localizer(fine, rng=np.random.default_rng(2))
    velocity = np.gradient(test.position, test.time, axis=0)
    errors, claimed = [], []
    for row, (attitude, height) in enumerate(zip(test.attitude, test.height, strict=True)):
        roll, pitch, yaw = attitude
        aiding = Aiding(roll=roll, pitch=pitch, yaw=yaw, height=height)
        estimate = localizer.step(test.image(row), aiding=aiding, time=test.time[row])
        if estimate.velocity is not None:
            errors.append(estimate.velocity - velocity[row])
            claimed.append(np.diagonal(estimate.joint)[2:])
    assert len(errors) > 20
    assert np.sqrt(np.square(errors).mean()) < 0.12
    assert 0.1 < np.square(errors).mean() / np.mean(claimed) < 4
    assert localizer.step(None).velocity is None


def test_it_says_how_fast_the_vehicle_goes_where_every_second_frame_is_missing(fine, flights):
    test = flights[1]
    localizer = Localizer(fine, rng=np.random.default_rng(2))
    velocity = np.gradient(test.position, test.time, axis=0)
    errors = []
    for row in range(len(test)):
        if row % 2:
            assert localizer.step(None).velocity is None
            continue
        estimate = localizer.step(test.image(row), time=test.time[row])
        if estimate.velocity is not None:
            errors.append(estimate.velocity - velocity[row])
    assert len(errors) > 4
    assert np.sqrt(np.square(errors).mean()) < 0.2


@pytest.fixture(scope="module")
def placed(fine, flights):
    """The first four places by a height, each height flown once."""

    @cache
    def placed(height):
        localizer = Localizer(fine, rng=np.random.default_rng(2))
        aiding, images = Aiding(height=height), (flights[1].image(row) for row in range(4))
        return [localizer.step(image, aiding=aiding).position for image in images]

    return placed


@pytest.mark.parametrize("height", [0.0, -1.0, 1e-9, 1e9, np.nan])
def test_a_height_that_cannot_be_is_as_none(placed, height):
    assert np.array_equal(placed(height), placed(None))


def test_a_stitched_picture_serves_as_well(flights):
    train, test = flights
    bare = replace(train, floor_file=None)
    texton_map = train_map(bare, method="fine", n_textons=6, rng=np.random.default_rng(1))
    error = [
        np.hypot(*(e.position - p))
        for e, p in zip(flown(texton_map, test), test.position, strict=True)
    ]
    assert np.median(error[5:]) < 0.06


def test_before_and_without_frames_there_is_an_honest_answer(fine):
    localizer = Localizer(fine, rng=np.random.default_rng(2))
    nothing = localizer.step(None)
    assert nothing.lost and nothing.position == pytest.approx([2.5, 2.5])
    assert nothing.spread[0] > 1 and nothing.measurement is None
    localizer.step(np.full((120, 160, 3), 128, np.uint8))
    localizer.reset()
    assert localizer.step(None).lost


def test_heights_that_are_missing_cost_no_map(fine, flights):
    train, _ = flights
    gaps = replace(train, height=np.where(train.frame % 3, train.height, np.nan))
    known = np.median(gaps.height[np.isfinite(gaps.height)])
    part = with_parts(
        fine, {"filter": Registration()}, flight=gaps, rng=np.random.default_rng(1)
    ).parts["filter"]
    assert part.camera[-1] == known


def test_a_heading_alone_is_no_attitude_to_learn_from(flights):
    train = flights[0].select(slice(0, 40))
    heading = train.attitude.copy()
    heading[:, :2] = np.nan
    learned = [
        train_map(
            replace(train, attitude=attitude), method="fine", n_textons=6,
            rng=np.random.default_rng(1),
        ).parts["filter"].trust.tolist()
        for attitude in (heading, None)
    ]  # fmt: skip
    assert learned[0] == learned[1]


def test_what_it_lacks_is_named(fine, flights):
    train, _ = flights
    localizer = Localizer(fine, rng=np.random.default_rng(2))
    with pytest.raises(MapError, match="given a histogram"):
        localizer.step(fine.histograms[0])
    with pytest.raises(MapError, match="trexton train FLIGHT --method fine"):
        with_parts(fine, {"filter": Registration()})
    with pytest.raises(MapError, match="train on one with images"):
        with_parts(fine, {"filter": Registration()}, flight=replace(train, frames=None))
    with pytest.raises(MapError, match="lacks the camera's heights.*stitch the picture"):
        with_parts(fine, {"filter": Registration()}, flight=replace(train, height=None))
    with pytest.raises(MapError, match="lacks the camera's heights.*stitch"):
        grounded = replace(train, height=np.where(train.frame % 2, np.nan, 0.0))
        with_parts(fine, {"filter": Registration()}, flight=grounded)
    with pytest.raises(MapError, match="train the map for it"):
        Registration().open({}, fine, np.random.default_rng(0))
    with pytest.raises(MapError, match="camera is .*expected its width"):
        fine.parts["filter"].with_learned(camera=np.zeros(2))
    with pytest.raises(ParameterError, match="height_sigma"):
        Registration(height_sigma=0.0)
