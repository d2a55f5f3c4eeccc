"""Landings by predicted touchdown: all see the same flight, each lands a vehicle of its own."""

from __future__ import annotations

from functools import partial

import numpy as np
import pytest
from onboard_tools import narrow_floor

from trexton.base.records import Record
from trexton.companion.build import notebook
from trexton.companion.experiments import touchdown
from trexton.companion.experiments.landings import Lander, fly_together, mission_over
from trexton.companion.wording import percent
from trexton.flights.flight import Flight
from trexton.localization.landing import LandingZone
from trexton.simulator.recording import record_flight
from trexton.simulator.simulator import PERIOD
from trexton.vision.camera import Camera

OPTIONS = {
    "flights": 2, "time_limit": 4.0, "armed_after": 1.0, "samples": 100, "textons": 8, "seed": 5,
    "survey": 100,
}  # fmt: skip


@pytest.fixture(scope="module")
def train(tmp_path_factory) -> Flight:
    folder = tmp_path_factory.mktemp("touchdown") / "room"
    camera = Camera(160, 120, 130.0)
    return record_flight(folder, frames=110, every=6, camera=camera, floor=narrow_floor())


@pytest.fixture(scope="module")
def record(train) -> Record:
    return touchdown.run(train, train, touchdown.Parameters(**OPTIONS))


def test_counts_and_rates_agree_with_the_series(record):
    for name, values in record.values["landers"].items():
        series = record.series[name]
        places = [place for place in series["touchdown_m"] if place[0] is not None]
        assert values["attempts"] == 2 and values["landings"] == len(places)
        assert values["inside"] == sum(np.hypot(*place) <= 0.6 for place in places)
        assert values["landed_rate"]["value"] == len(places) / 2
        assert values["inside_of_flights"]["value"] == values["inside"] / 2


def test_flights_over_one_floor_are_alike():
    """The kept record: where it is not so, `rates` of its counts are to be put into it again."""
    kept = notebook.reference("touchdown")
    for name, lander in kept.values["landers"].items():
        floors = [floor[name] for floor in kept.values["floors"].values()]
        for key, rate in touchdown.rates(floors).items():
            assert lander[key] == pytest.approx(rate)
            together = touchdown.rates([lander])[key]
            assert rate["value"] == together["value"]
            assert rate["low"] <= together["low"] and together["high"] <= rate["high"]
    landed = kept.values["landers"]["field"]["landed_rate"]  # from none to 17 of 20, by the floor
    assert landed["high"] - landed["low"] > 0.3


def test_all_fly_the_same_flight_and_each_lands_a_vehicle_of_its_own(train):
    mission = mission_over(train, touchdown.Parameters(**OPTIONS | {"time_limit": 20.0}), seed=5)
    landers = {
        "never": Lander(None, partial(LandingZone, radius=1e-6)),
        "at once": Lander(None, partial(LandingZone, radius=100.0)),
    }
    never, at_once = fly_together(mission, landers, 0).values()
    assert at_once.triggered and not never.triggered and len(at_once.path) < len(never.path)
    armed = round(mission.parameters.armed_after / PERIOD)
    np.testing.assert_array_equal(at_once.path[:armed], never.path[:armed])
    np.testing.assert_array_equal(at_once.zone, never.zone)
    assert never.wait_s == pytest.approx(20, abs=PERIOD)


def test_coarse_to_fine_knows_where_it_is_when_it_lands(record):
    fine = record.values["landers"]["fine"]
    assert fine["landings"] >= 1 and fine["trigger_error_cm"] < 2


def test_the_page_shows_the_record(record):
    table = touchdown.table(record)
    for name, share in zip(touchdown.LANDERS, table["landed, of flights"], strict=True):
        assert share == percent(record.values["landers"][name]["landed_rate"])
    inside = record.values["landers"]["fine"]["inside"]
    assert f"with `fine` {percent(inside / 2)}" in touchdown.finding(record)
    assert len(touchdown.targets(record).axes) == len(touchdown.LANDERS)
