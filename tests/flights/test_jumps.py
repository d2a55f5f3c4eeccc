"""Heights and yaws that jump and come back are named by frame, and left empty by a repair."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sound_flights import SOUND, sound

from trexton.flights.check import repair_flight
from trexton.flights.folder import read_flight
from trexton.flights.jumps import jump_doubts
from trexton.flights.plausibility import warnings
from trexton.flights.writing import write_flight

HEIGHT = ["lanes with noise", "carried by hand", "fast quadrotor", "hover", "outdoors", "boat"]
YAW = ["lanes, nose ahead", "circle, steady turn", "fast quadrotor", "carried by hand"]


def damaged(flight, column, rows, values):
    changed = getattr(flight, column).copy()
    if column == "height":
        changed[rows] += values * np.median(changed)
    else:
        changed[rows, 2] = np.angle(np.exp(1j * (changed[rows, 2] + values)))
    return replace(flight, **{column: changed})


@settings(max_examples=80, deadline=None, derandomize=True)
@given(
    seed=st.integers(0, 10**6), column=st.sampled_from(["height", "attitude"]),
    number=st.integers(0, 10**6), count=st.integers(1, 14), in_a_row=st.booleans(),
)  # fmt: skip
def test_rows_that_jump_alone_are_named_and_left_out(seed, column, number, count, in_a_row):
    kinds = HEIGHT if column == "height" else YAW
    flight, rng = sound(kinds[number % len(kinds)], seed, 300), np.random.default_rng(seed)
    if flight.height is None and column == "height":
        flight = replace(flight, height=1.5 + 0.01 * rng.standard_normal(300))
    begin = int(rng.integers(0, 300 - count))
    rows = np.arange(begin, begin + count) if in_a_row else rng.choice(300, count, replace=False)
    odd = damaged(flight, column, rows, rng.uniform(1.0, 2.5) * rng.choice([-1, 1]))
    (doubt,) = jump_doubts(odd)
    assert doubt.startswith(f"{count} {'height' if column == 'height' else 'yaw'}")
    mended = getattr(doubt.mend(odd), column)
    empty = np.isnan(mended) if column == "height" else np.isnan(mended).all(axis=1)
    np.testing.assert_array_equal(np.flatnonzero(empty), np.sort(rows))
    np.testing.assert_array_equal(mended[~empty], getattr(flight, column)[~empty])


@pytest.mark.parametrize("kind", SOUND)
def test_nothing_jumps_in_sound_flights(kind):
    for seed in range(12):
        assert not [*jump_doubts(sound(kind, seed, (60, 150, 300, 500)[seed % 4]))]


def test_a_repair_writes_what_is_left(tmp_path):
    flight = sound("fast quadrotor", 4, 300)
    odd = damaged(flight, "height", np.arange(100, 110), 1.5)
    odd = damaged(odd, "attitude", np.array([20, 200]), 1.5)
    said = warnings(odd)
    assert said[0].startswith("10 heights jumped to and back from (frames 100 to 109)")
    assert said[1].startswith("2 yaws jumped to and back from (frames 20, 200)") and len(said) == 2
    write_flight(replace(odd, histograms=flight.histograms), tmp_path / "odd")
    done = repair_flight(tmp_path / "odd", tmp_path / "mended")
    assert [line.endswith("left empty") for line in done] == [True, True]
    mended = read_flight(tmp_path / "mended")
    assert not warnings(mended) and np.isnan(mended.height).sum() == 10
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(mended.attitude[:, 2])), [20, 200])
