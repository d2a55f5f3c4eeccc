"""Triggered landings: the tally by hand, the closed loop on a small room, figures from the
record.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from conftest import small_flight

from trexton.base.errors import ParameterError
from trexton.base.records import Record
from trexton.companion.executor import working_on
from trexton.companion.experiments import triggered_landing
from trexton.companion.experiments.landings import Attempt
from trexton.companion.experiments.triggered_landing import summarize_attempts
from trexton.simulator.floor import Floor
from trexton.simulator.recording import record_flight
from trexton.simulator.simulator import PERIOD
from trexton.vision.camera import Camera, MapImage

SMALL = Camera(160, 120, 130.0)
OPTIONS = {
    "landings": 3,
    "time_limit": 12.0,
    "armed_after": 1.0,
    "samples": 100,
    "textons": 8,
    "particles": 30,
    "neighbors": 3,
}


@pytest.fixture(scope="module")
def train(tmp_path_factory):
    coarse = np.random.default_rng(1).integers(0, 256, (16, 16, 3), dtype=np.uint8)
    floor = Floor(
        MapImage.from_extent(
            cv2.resize(coarse, (768, 768), interpolation=cv2.INTER_CUBIC), 0.0, 3.0, 256
        )
    )
    return record_flight(
        tmp_path_factory.mktemp("landing") / "room", frames=110, every=6, floor=floor, camera=SMALL
    )


@pytest.fixture(scope="module")
def record(train) -> Record:
    return triggered_landing.run(train, train, triggered_landing.Parameters(**OPTIONS))


def attempt(truth: float | None, touchdown: float) -> Attempt:
    """A landing at a distance from a zone at (1, 2), to its right; None: never triggered."""
    zone, nowhere = np.array([1.0, 2.0]), np.full(2, np.nan)
    if truth is None:
        return Attempt(zone, 60.0, nowhere, nowhere, nowhere, np.zeros((1, 2)))
    guess, truth, touchdown = (zone + (distance, 0.0) for distance in (0.0, truth, touchdown))
    return Attempt(zone, 10.0, guess, truth, touchdown, np.zeros((1, 2)))


def test_the_tally_of_landings_made_by_hand():
    attempts = [
        attempt(0.5, 0.2),
        attempt(0.7, 0.5),
        attempt(0.1, 0.74),
        attempt(None, 0),
        attempt(0.9, 0.78),
        attempt(0.3, 0.0),
    ]
    values = summarize_attempts(attempts, triggered_landing.Parameters())
    assert (values["attempts"], values["landings"], values["never_triggered"]) == (6, 5, 1)
    assert values["inside"] == 3
    assert np.isclose(values["outlier_mean_cm"]["value"], 16) and np.isclose(
        values["outlier_mean_cm"]["low"], 14
    )
    assert (
        values["inside_rate"]["value"] == 0.6
        and values["inside_rate"]["low"] < 0.6 < values["inside_rate"]["high"]
    )
    assert values["triggered_inside_rate"]["value"] == 0.6
    assert values["first_flights"] == {"inside": 3}


def test_nothing_but_missed_landings_is_a_result_too():
    values = summarize_attempts([attempt(None, 0)] * 3, triggered_landing.Parameters())
    assert values["landings"] == 0 and values["never_triggered"] == 3
    assert values["inside_rate"] is None and values["outlier_mean_cm"] is None


def test_the_record_agrees_with_its_series(record, train):
    series, values = record.series, record.values
    assert len(series["zone_m"]) == values["attempts"] == 3
    assert values["landings"] + values["never_triggered"] == 3
    low, high = train.position.min(axis=0) + 0.6, train.position.max(axis=0) - 0.6
    for zone, beyond, touchdown, path in zip(
        *(series[key] for key in ("zone_m", "beyond_cm", "touchdown_m", "paths_m")), strict=False
    ):
        assert (zone >= low).all() and (zone <= high).all()
        if beyond is not None:
            assert np.isclose(beyond, 100 * (np.hypot(*np.subtract(touchdown, zone)) - 0.6))
            assert np.allclose(path[-1], touchdown, atol=1e-3)
    assert (
        sum(beyond is not None and beyond <= 0 for beyond in series["beyond_cm"])
        == values["inside"]
    )


def test_with_the_true_position_every_trigger_is_inside(record):
    perfect = record.values["perfect"]
    assert perfect["landings"] >= 1
    assert perfect["triggered_inside_rate"]["value"] == 1


def test_equal_seeds_and_any_number_of_processes_give_the_same_record(record, train):
    with working_on(processes=2):
        again = triggered_landing.run(train, train, triggered_landing.Parameters(**OPTIONS))
    one = {"landings": 1, "time_limit": 2.0}
    other = triggered_landing.run(
        train, train, triggered_landing.Parameters(**OPTIONS | one | {"seed": 2})
    )
    for key in ("parameters", "values", "series", "provenance"):
        assert getattr(again, key) == getattr(record, key)
    assert other.series["zone_m"][0] != record.series["zone_m"][0]


def test_a_zone_that_is_never_reached_ends_at_the_time_limit(train):
    found = triggered_landing.run(
        train,
        train,
        triggered_landing.Parameters(
            **OPTIONS | {"radius": 0.01, "landings": 1, "time_limit": 2.0}
        ),
    )
    assert found.values["never_triggered"] == 1 and found.series["beyond_cm"] == [None]
    assert len(found.series["paths_m"][0]) == pytest.approx(2.0 / PERIOD, abs=1.1)
    assert (
        triggered_landing.first_flights(found).axes[0].get_title(loc="left") == "1: never triggered"
    )
    assert len(triggered_landing.table(found)) == 3


@pytest.mark.parametrize(
    "options, message",
    [
        ({"radius": 2.0}, "does not fit"),
        ({"radius": -1.0}, "radius"),
        ({"landings": 0}, "landings is 0"),
        ({"armed_after": 99.0}, "armed after"),
    ],
)
def test_nonsense_is_refused(train, options, message):
    with pytest.raises(ParameterError, match=message):
        triggered_landing.run(train, train, triggered_landing.Parameters(**OPTIONS | options))


def test_a_flight_without_a_floor_or_a_camera_cannot_serve(train):
    for flight in (small_flight(), replace(train, camera=None), replace(train, floor_file=None)):
        with pytest.raises(ParameterError, match="no picture of its floor or no camera"):
            triggered_landing.run(flight, flight, triggered_landing.Parameters())


def test_the_figures_show_the_record(record):
    plans = [axes for axes in triggered_landing.first_flights(record).axes if axes.patches]
    assert [np.round(axes.patches[0].center, 9).tolist() for axes in plans] == np.round(
        record.series["zone_m"], 9
    ).tolist()
    assert np.allclose(plans[0].lines[0].get_xydata(), record.series["paths_m"][0])


def test_the_table_stands_beside_the_paper(record):
    table = triggered_landing.table(record)
    assert table.iloc[0]["Landings"] == 6 and table.iloc[0]["Inside"] == 4
    assert table.iloc[1]["Landings"] == record.values["landings"]
