"""Sound recordings of many kinds raise no warning; damage is named, and mended where it can be."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from conftest import small_flight
from hypothesis import given, settings
from hypothesis import strategies as st
from sound_flights import SOUND, round_, sound

from trexton.flights.flight import Flight, area_around
from trexton.flights.importers.axes import (
    AXES,
    TAKEN,
    attitude_from_quaternions,
    quaternions_from_attitude,
)
from trexton.flights.plausibility import warnings

FLOWN = st.tuples(st.sampled_from(sorted(SOUND)), st.integers(0, 10**6), st.integers(60, 500))


def test_sound_recordings_raise_at_most_one_false_alarm_in_a_hundred():
    tried, alarms = [], []

    @settings(max_examples=400, deadline=None, database=None, derandomize=True)
    @given(FLOWN)
    def fly(drawn):
        tried.append(drawn)
        alarms.extend((*drawn, str(each)) for each in warnings(sound(*drawn)))

    fly()
    assert len(tried) >= 300 and {kind for kind, *_ in tried} == set(SOUND)
    listed = "\n".join(map(str, alarms))
    assert len(alarms) <= 0.01 * len(tried), f"{len(alarms)} of {len(tried)} raised:\n{listed}"


def mended(flight: Flight) -> Flight:
    """As `check --repair` mends it."""
    for _ in range(10):
        doubt = next((each for each in warnings(flight) if each.mend), None)
        if doubt is None:
            break
        flight = doubt.mend(flight)
    return flight


def read_as(attitude: np.ndarray, meant: str, taken: str, order: int = 0) -> np.ndarray:
    """An attitude whose quaternions are of some axes, read as of others, or in another order."""
    turns = quaternions_from_attitude(attitude, AXES[meant])
    return attitude_from_quaternions(np.roll(turns, order, axis=1), AXES[taken])


UNITS = {
    "positions in mm": lambda f: {"position": f.position * 1e3},
    "positions and area in mm": lambda f: {
        "position": f.position * 1e3, "area": tuple(1e3 * np.array(f.area)),
    },
    "heights in mm": lambda f: {"height": f.height * 1e3},
    "z down": lambda f: {"height": -f.height},
    "heights all 0": lambda f: {"height": 0 * f.height},
    "degrees": lambda f: {"attitude": np.degrees(f.attitude)},
    "milliseconds": lambda f: {"time": f.time * 1e3},
    "nanoseconds": lambda f: {"time": f.time * 1e9},
    "z axis down": lambda f: {"attitude": read_as(f.attitude, "camera", "rfu")},
    "vehicle for camera": lambda f: {
        "attitude": read_as(f.attitude, "camera", "flu"), "notes": (TAKEN + "flu",),
    },
    "w, x, y, z": lambda f: {
        "attitude": read_as(f.attitude, "camera", "camera", 1), "notes": (TAKEN + "camera",),
    },
}  # fmt: skip


@pytest.mark.parametrize("damage", UNITS)
@pytest.mark.parametrize("kind", ["circle, steady turn", "fast quadrotor", "fixed wing"])
def test_units_and_axes_are_named_and_mended(kind, damage):
    flight = sound(kind, 5, 400)
    if flight.height is None:
        flight = replace(flight, height=np.full(400, 1.5))
    damaged = replace(flight, **UNITS[damage](flight))
    assert warnings(damaged), damage
    if (kind, damage) == ("fast quadrotor", "milliseconds"):
        return  # frames every 17 s may be meant: named alone
    again = mended(damaged)
    assert [str(each) for each in warnings(again)] == []
    for key in ("time", "position", "height", "attitude"):
        expected = None if (key, damage) == ("height", "heights all 0") else getattr(flight, key)
        if expected is None:
            assert getattr(again, key) is None
        elif key == "attitude" and damage in ("z axis down", "w, x, y, z", "vehicle for camera"):
            turned = np.angle(np.exp(1j * (again.attitude - expected)))
            np.testing.assert_allclose(turned, 0, atol=1e-6)
        else:
            np.testing.assert_allclose(getattr(again, key), expected, rtol=1e-9)


def test_stamps_in_days_are_seconds_again():
    flight = sound("circle", 3, 200)
    (doubt,) = warnings(replace(flight, time=45_000 + flight.time / 86400))
    np.testing.assert_allclose(np.diff(doubt.mend(replace(flight, time=flight.time / 86400)).time),
                               np.diff(flight.time), atol=1e-9)  # fmt: skip


@pytest.mark.parametrize("kind", ["circle, steady turn", "lanes, nose ahead", "fast quadrotor"])
def test_a_repair_of_angles_leaves_those_that_are_radians(kind):
    flight = sound(kind, 5, 400)
    degrees = np.degrees(flight.attitude)
    mixed = np.column_stack([flight.attitude[:, :2], degrees[:, 2]])
    (doubt,) = warnings(replace(flight, attitude=mixed))
    assert "degrees?" in doubt and doubt.done == "yaw read as degrees"
    alone = degrees * (np.nan, np.nan, 1)
    (doubt,) = warnings(replace(flight, attitude=alone))
    assert "degrees?" in doubt and doubt.done == "yaw read as degrees"
    again = doubt.mend(replace(flight, attitude=mixed))
    np.testing.assert_allclose(again.attitude, flight.attitude, atol=1e-9)
    late = np.where(np.arange(400)[:, None] > 250, degrees, flight.attitude)
    for unsure in (late, 100 * degrees):  # some rows, and hundredths: named, not mended
        (doubt,) = warnings(replace(flight, attitude=unsure))
        assert "degrees?" in doubt and doubt.mend is None


@pytest.mark.parametrize("height", [None, 1.5])
def test_a_slow_walk_in_centimetres_is_named(height):
    time = np.arange(200) * 0.08
    turn = np.array([2 + 1.5 * np.cos(0.4 * time), 2 + np.sin(0.4 * time)]).T
    flight = replace(sound("circle", 3, 200), time=time, position=turn, area=(0, 5, 0, 5))
    flight = replace(flight, height=None if height is None else np.full(200, height))
    assert not warnings(flight)
    (doubt,) = warnings(replace(flight, position=100 * turn, area=(0, 500, 0, 500)))
    assert "positions in centimetres?" in doubt
    np.testing.assert_allclose(doubt.mend(replace(flight, position=100 * turn)).position, turn)


def test_metres_of_gps_are_not_taken_for_centimetres():
    time = np.arange(40.0)
    place = np.column_stack([20.0 * (time % 2), 25 + 25 * np.cos(time)])
    flight = replace(sound("circle", 3, 40), time=time, position=place, area=(-5, 25, -5, 55))
    assert any("centimetres" in doubt for doubt in warnings(flight))
    assert not warnings(replace(flight, origin=(47.0, 8.0)))


@pytest.mark.parametrize("rate", [10.0, 100.0])
@pytest.mark.parametrize("noise", [0.0002, 0.0005, 0.002])
def test_a_hover_tells_no_unit_by_the_noise_of_its_positions(rate, noise):
    rng, time = np.random.default_rng(2), np.arange(0, 60, 1 / rate)
    place = round_(np.minimum(time, 25.0), rng) + noise * rng.standard_normal((len(time), 2))

    def flown(factor: float, rows: slice = slice(None)) -> list[str]:
        count = len(time[rows])
        positions = factor * place[rows]
        flight = Flight(
            name="hover", frame=np.arange(count), time=time[rows], position=positions,
            area=area_around(positions, 0.02, 0.01), histograms=np.eye(3)[np.arange(count) % 3],
            height=np.full(count, 12.0),
        )  # fmt: skip
        return [each for each in warnings(flight) if "stood still" not in each]

    assert not flown(1) and not flown(1, slice(-len(time) // 2, None))
    assert [each.done for each in flown(1000)] == ["positions and area read as millimetres"]
    assert [each.done for each in flown(100)] == ["positions and area read as centimetres"]


def test_flights_of_two_days_in_one_are_named():
    flight = sound("circle, steady turn", 5, 400)
    late = flight.time + 86400.0 * (np.arange(400) >= 300)
    (doubt,) = warnings(replace(flight, time=late))
    assert "frames 299 and 300 lie 24 hours apart" in doubt and "--split 0.75" in doubt
    hour = flight.time + 3600 * (np.arange(400) >= 300) - np.ptp(flight.time)  # of another clock
    late = np.where(np.arange(400) >= 300, hour, flight.time)
    (doubt,) = warnings(replace(flight, time=late))
    assert "hours apart: two flights?" in doubt
    assert not warnings(replace(flight, time=flight.time + 1200.0 * (np.arange(400) >= 300)))
    assert doubt.mend is None
    parted = {"train": (0, 299), "test": (300, 399)}
    assert not warnings(replace(flight, time=late, split=parted))
    assert not warnings(replace(flight, time=flight.time + 600.0 * (np.arange(400) >= 300)))


def test_features_that_count_or_stand_still_are_named():
    """Both train well, and place nothing later."""
    flight = small_flight(40)
    assert not warnings(flight)
    counting = np.column_stack([flight.histograms, 12.6 - 0.01 * np.arange(40)])
    (said,) = warnings(replace(flight, histograms=counting, features="volts"))
    assert "feature 4 only rises or falls: a clock or a counter?" in said
    held = flight.histograms.copy()
    held[10:30] = held[10]
    (said,) = warnings(replace(flight, histograms=held))
    expected = (
        f"from frame {flight.frame[11]} on 19 histograms repeat the last while the vehicle flew"
    )
    assert said.startswith(expected)
    hover = flight.position.copy()
    hover[10:30] = hover[10] + 0.001 * np.arange(20)[:, None]
    assert not any(
        "repeat" in said for said in warnings(replace(flight, histograms=held, position=hover))
    )


def test_a_test_split_alone_would_train():
    flight = replace(
        sound("fast quadrotor", 5, 400), split={"training": (0, 99), "test": (100, 399)}
    )
    assert any("no split is named train beside test" in each for each in warnings(flight))


@pytest.mark.parametrize("kind", ["circle, steady turn", "fast quadrotor"])
def test_an_area_in_another_unit_is_named(kind):
    """The map of a room would be taken for one of a field: errors look small beside it."""
    flight = sound(kind, 5, 400)
    low, high = np.reshape(flight.area, (2, 2)).T
    center, half = (low + high) / 2, (high - low) / 2
    wide = replace(flight, area=tuple(np.ravel([center - 100 * half, center + 100 * half], "F")))
    (doubt,) = (each for each in warnings(wide) if "area_m" in each)
    assert "write both in metres" in doubt
    assert not any("area_m" in each for each in warnings(flight))
