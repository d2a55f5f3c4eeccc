"""Flights over floors that nothing was chosen on, from their frames to what autopilots make of
them: at most a tenth worse than each image sent once, and the truth where they believe it is.
"""

from __future__ import annotations

import numpy as np
import pytest

from trexton.localization.training import train_map
from trexton.simulator import Floor, record_flight

pytest.importorskip("pymavlink", reason="the extra 'mavlink' is not installed")

from onboard_proof import fixes, proof  # noqa: E402

WRONG = pytest.mark.xfail(reason="on one floor in ten the field is wrong itself")
BOUNDS_M = {"px4": 0.01, "ardupilot": 0.1}  # least deviations that the page gives for `fine`


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
    painted = Floor.painted("moved", floor)
    survey = record_flight(tmp_path / "survey", floor=painted, seed=floor, frames=800)
    test = record_flight(
        tmp_path / "test", pattern="waypoints", floor=painted, seed=floor + 1, frames=415
    )
    texton_map = train_map(survey, method=method, rng=np.random.default_rng(1))
    check(texton_map, test, method)


@pytest.mark.slow
def test_the_authors_flight(cyberzoo):
    texton_map = train_map(cyberzoo.part("train"), method="field", rng=np.random.default_rng(1))
    check(texton_map, cyberzoo.part("test"), "field")


def check(texton_map, test, method: str) -> None:
    made = fixes(texton_map, test)
    for profile, bound in BOUNDS_M.items():
        floor = bound if method == "fine" else None
        for delay in (0.0, 0.06, 0.15):
            wire, best = proof(texton_map, test, profile, delay, floor, made)
            print(f"{method} {profile} {delay:.2f} s: {wire}, each image once: {best}")
            assert wire.error_m < 1.1 * best.error_m and not wire.dropped
            assert wire.inside >= 0.8
