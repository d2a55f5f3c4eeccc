"""Flights over floors that nothing was chosen on, from their frames to what autopilots make of
them: at most a tenth worse than each image sent once, and the truth where they believe it is.
"""

from __future__ import annotations

import numpy as np
import pytest

from trexton.localization.training import train_map
from trexton.onboard.fix import Fix
from trexton.simulator.recording import record_flight
from trexton.vision.camera import Camera

pytest.importorskip("pymavlink", reason="the extra 'mavlink' is not installed")

from onboard_proof import flights, kidnapped, proofs  # noqa: E402
from proof import first, wrong  # noqa: E402

WRONG = pytest.mark.xfail(reason="over this floor the field is wrong itself")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "floor"),
    [
        ("field", 907),
        pytest.param("field", 911, marks=WRONG),
        ("fine", 907),
        ("fine", 911),
    ],
)
def test_floors_of_its_own(method, floor, tmp_path):
    survey, test = flights(tmp_path, "moved", floor)
    texton_map = train_map(survey, method=method, rng=np.random.default_rng(1))
    check(texton_map, test, method)


@pytest.mark.slow
def test_the_authors_flight(cyberzoo):
    texton_map = train_map(cyberzoo.part("train"), method="field", rng=np.random.default_rng(1))
    check(texton_map, cyberzoo.part("test"), "field")


def check(texton_map, test, method: str) -> None:
    for profile, delay, wire, best in proofs(texton_map, test, method):
        print(f"{method} {profile} {delay:.2f} s: {wire}, each image once: {best}")
        assert wire.error_m < 1.1 * best.error_m and not wire.dropped
        assert wire.inside >= 0.8


def test_a_kidnapped_flight_is_the_same_in_another_order(tmp_path):
    flight = record_flight(tmp_path / "f", frames=50, camera=Camera(64, 48, 52.0), every=3)
    cut, since_s = kidnapped(flight, 2.4)
    assert len(cut) == 50 and (cut.time == flight.time).all()
    assert np.flatnonzero(since_s == 0).size == 5 and since_s.max() == pytest.approx(9 * 0.24)
    step = np.argmin(np.abs(flight.position - cut.position[10]).sum(axis=1))
    assert step in (20, 30, 40)  # not the piece that came next
    assert (cut.image(10) == flight.image(step)).all()
    assert (cut.attitude[10] == flight.attitude[step]).all()


def test_wrong_is_what_lies_beyond_four_deviations_and_is_not_lost():
    claimed = np.diag([0.01, 0.04])
    places = [
        ([0, 0], True),
        ([0.5, 0], True),
        ([0.5, 0], False),
        ([0.39, 0], False),
        ([0, 0.81], False),
    ]
    fixes = [
        Fix(0.1 * row + 7, row, np.array(at), np.diagonal(claimed) ** 0.5, claimed, lost, True)
        for row, (at, lost) in enumerate(places)
    ]  # fmt: skip
    assert wrong(fixes, np.zeros((5, 2))).tolist() == [False, False, True, False, True]
    assert first(fixes) == pytest.approx(0.2) and first(fixes[:2]) == pytest.approx(0.1)
