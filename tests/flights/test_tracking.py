"""Rows at which tracking was lost are named, and left out where it is sure which they are."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sound_flights import round_, sound

from trexton.flights.flight import Flight, area_around
from trexton.flights.plausibility import warnings
from trexton.flights.tracking import lost_rows


@settings(max_examples=60, deadline=None)
@given(
    seed=st.integers(0, 10**6), share=st.floats(0.02, 0.12),
    kind=st.sampled_from([
        "circle", "circle, steady turn", "lanes", "lanes with noise", "waypoints", "rover",
        "carried by hand", "figure of eight", "fast quadrotor", "along a wall", "outdoors",
    ]), how=st.sampled_from(["zero", "frozen", "frozen first", "body", "body now and then"]),
)  # fmt: skip
def test_lost_tracking_is_named(seed, kind, share, how):
    flight, rng = sound(kind, seed, 300), np.random.default_rng(seed)
    position = flight.position.copy()
    fastest = np.hypot(*np.diff(position, axis=0).T).max()
    count = max(4, round(share * 300))
    begin = int(rng.integers(20, 270 - count))
    damaged = np.arange(begin, begin + count)
    if how == "zero":
        damaged = np.sort(rng.choice(np.arange(10, 290), count, replace=False))
        position += 20 * fastest - position.min(axis=0)  # where no flight passes 0, 0
        position[damaged] = 0
    elif how == "frozen first":
        damaged = np.arange(count)
        position[damaged] = position[count]
        if np.hypot(*(position[count + 1] - position[count])) < max(0.06, 0.6 * fastest):
            return  # as slowly as whoever takes off
    elif "body" in how:
        if "then" in how:
            damaged = np.sort(rng.choice(np.arange(10, 290), count, replace=False))
        position[damaged] = position.max(axis=0) + 3 * np.ptp(position, axis=0)
    else:
        count = max(count, 20)
        damaged = np.arange(begin + 1, begin + count)
        position[damaged] = position[begin]
        if np.hypot(*(position[begin + count] - position[begin])) < 3 * fastest:
            return  # it came back to where it froze: nothing tells
    found = [rows for _, rows, _ in lost_rows(flight.time, position)]
    assert found and set(np.concatenate(found)) >= set(damaged.tolist())


@pytest.mark.parametrize("share", [0.02, 0.047, 0.12])
@pytest.mark.parametrize("value", [(0.0, 0.0), (-3.0, 1.0)])
def test_rows_of_one_value_in_a_walk_are_named_and_no_others(share, value):
    """Of a noisy walk: it is fast from row to row, and slow over several."""
    blamed = 0
    for seed in range(1000, 1100):
        flight, rng = sound("carried by hand", seed, 300), np.random.default_rng(seed)
        position = flight.position - flight.position.min(axis=0) + 1
        damaged = rng.choice(300, round(share * 300), replace=False)
        position[damaged] = value
        found = np.concatenate([rows for _, rows, _ in lost_rows(flight.time, position)])
        assert set(found) >= set(damaged)
        blamed += len(found) > len(damaged)
    assert blamed <= 1  # as many as of walks that are sound


@pytest.mark.parametrize("share", [0.35, 0.5, 0.7])
@pytest.mark.parametrize("in_a_row", [False, True])
def test_most_of_a_flight_at_the_origin_is_named_and_left_out(share, in_a_row, rng):
    flight = sound("circle", 3, 200)
    count = round(share * len(flight))
    lost = np.arange(30, 30 + count) if in_a_row else rng.choice(len(flight), count, replace=False)
    position = flight.position.copy()
    position[lost] = 0
    (doubt,) = (each for each in warnings(replace(flight, position=position)) if "exactly" in each)
    assert doubt.startswith(f"{count} positions lie at exactly (0, 0)")
    mended = doubt.mend(replace(flight, position=position))
    np.testing.assert_array_equal(np.flatnonzero(~mended.located), np.sort(lost))


def test_many_rows_of_another_place_are_named_but_stay():
    flight = sound("circle", 3, 200)
    position = flight.position.copy()
    position[120:] += (30, 12)
    doubts = warnings(replace(flight, position=position))
    (doubt,) = (each for each in doubts if "cannot be flown" in each)
    assert "(frames 120 to 199)" in doubt and doubt.mend is None


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(
    "kind", ["circle", "lanes with noise", "carried by hand", "fast quadrotor"]
)
@pytest.mark.parametrize("jitter", [0.0, 1e-5])
def test_a_place_that_froze_while_the_rest_lived_is_named(seed, kind, jitter):
    flight, rng = sound(kind, seed, 300), np.random.default_rng(seed)
    position, height = flight.position.copy(), 1.5 + 0.01 * rng.standard_normal(300)
    for begin in (60, 150, 220):  # x and y are held, the height goes on
        position[begin : begin + 40] = position[begin] + jitter * rng.standard_normal((40, 2))
        if np.hypot(*(position[begin + 40] - position[begin])) < 0.3:
            return  # it came back to where it froze: nothing tells
    found = [rows for _, rows, sure in lost_rows(flight.time, np.column_stack([position, height]))]
    expected = [row for begin in (60, 150, 220) for row in range(begin + 1, begin + 40)]
    assert np.concatenate(found).tolist() == expected


@pytest.mark.parametrize("rows", [slice(0, 30), slice(270, 300)])
def test_a_place_that_froze_at_an_end_in_flight_is_named(rows):
    flight = sound("circle", 3, 300)
    position = flight.position.copy()
    position[rows] = position[30 if rows.start == 0 else 269]
    (doubt,) = warnings(replace(flight, position=position))
    assert doubt.startswith("30 positions lie at one place") and not warnings(doubt.mend(flight))


@pytest.mark.parametrize("share", [0.25, 0.3, 0.36])
@pytest.mark.parametrize("how", ["one place", "anywhere", "another body"])
def test_rows_lost_one_by_one_are_found_where_they_are_many(share, how):
    rng, time = np.random.default_rng(5), np.arange(900) / 30
    place = round_(time, rng) + 0.001 * rng.standard_normal((900, 2))
    lost = rng.random(900) < share
    shown = {"one place": np.full((900, 2), (4.0, -3.0)), "anywhere": rng.uniform(-6, 6, (900, 2)),
             "another body": 2 * round_(-time, rng)}[how]  # fmt: skip
    place[lost] = shown[lost]
    found = lost_rows(time, place)
    rows = np.concatenate([rows for _, rows, _ in found])
    assert all(sure for *_, sure in found)
    assert lost[rows].mean() > 0.97 and len(rows) > 0.97 * lost.sum()


def test_lost_rows_are_no_speed():
    """A logger writes -999 where it has no position."""
    time = np.arange(240) / 10
    place = round_(time, np.random.default_rng(0))
    place[::6] = -999.0
    flight = Flight(
        name="lost", frame=np.arange(240), time=time, position=place, area=area_around(place),
        histograms=np.eye(3)[np.arange(240) % 3],
    )  # fmt: skip
    (only,) = warnings(flight)
    assert "40 positions lie where none can be flown to" in only


@pytest.mark.parametrize("drop", [5, 15, 30])
@pytest.mark.parametrize("rows", [slice(390, 400), slice(400, 410)])
def test_rows_of_another_place_beside_a_dropout_are_named_and_no_others(drop, rows):
    """Over the dropout any place can be flown to: they must not stand for all that follows."""
    for seed, kind in enumerate(["circle", "lanes with noise", "waypoints", "rover", "outdoors"]):
        flight = sound(kind, seed, 900)
        kept = np.abs(flight.time - flight.time[400] - drop / 2) >= drop / 2 - 1e-6
        time, place = flight.time[kept], flight.position[kept]
        place[rows] = place.max(axis=0) + 2 * np.ptp(place, axis=0)
        found = np.concatenate([rows for _, rows, _ in lost_rows(time, place)])
        np.testing.assert_array_equal(found, np.arange(rows.start, rows.stop))


@pytest.mark.parametrize("standing", [0.5, 0.9, 0.97, 0.99])
@pytest.mark.parametrize("noise", [0.0, 0.0003, 0.003])
@pytest.mark.parametrize("back", [True, False])
def test_who_stands_long_and_then_flies_is_not_lost(standing, noise, back):
    """The flown part was left out, as faster than the rest."""
    rng, flown = np.random.default_rng(5), 120
    share = np.linspace(0, 1, flown)  # slow at first and at last
    angle = (3 - 2 * share) * share**2 * (2 * np.pi if back else 3.5)
    way = np.column_stack([1 - np.cos(angle), np.sin(angle)])
    ground = round(flown * standing / (1 - standing))
    before = round(0.7 * ground)
    position = np.concatenate([np.tile(way[0], (before, 1)), way])
    position = np.concatenate([position, np.tile(way[-1], (ground - before, 1))]) + 1
    position += noise * rng.normal(size=position.shape)
    time = np.arange(len(position)) / 25
    assert lost_rows(time, position) == []
    position[before + 20 : before + 26] += 9
    ((_, rows, sure),) = lost_rows(time, position)
    assert sure and rows.tolist() == list(range(before + 20, before + 26))
