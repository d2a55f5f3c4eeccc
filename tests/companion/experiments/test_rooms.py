"""Rooms that change: one path under every change, and a record whose numbers are those shown."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from onboard_tools import CAMERA, colourful_floor, narrow_floor

from trexton.base.errors import ParameterError
from trexton.companion.experiments import rooms
from trexton.companion.wording import distance
from trexton.localization.localizer import Localizer
from trexton.localization.training import train_map
from trexton.simulator.recording import record_flight


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    """It lends its floor and its camera."""
    folder = tmp_path_factory.mktemp("rooms") / "flight"
    return record_flight(folder, frames=5, camera=CAMERA, floor=narrow_floor())


@pytest.fixture(scope="module")
def record(flight):
    with pytest.MonkeyPatch.context() as patch:  # fewer textons, and patches of a frame
        patch.setattr(rooms, "train_map", partial(train_map, n_textons=8))
        patch.setattr(rooms, "Localizer", partial(Localizer, samples=100))
        return rooms.run(flight, flight, rooms.Parameters(survey=100, frames=10))


def test_every_change_is_flown_by_every_method(record):
    changes = record.values["changes"]
    assert set(changes) - {"left"} == set(rooms.CHANGES)
    for found in changes.values():
        assert set(found) == set(rooms.METHODS)
        for each in found.values():
            assert 0 < each["error_cm"]["low"] <= each["error_cm"]["high"]
            wrong, lost = each["wrong"], each["lost"]
            assert min(wrong, lost) >= 0 and wrong + lost <= 1 + 1e-9


def test_finding_tables_and_figure_say_what_the_record_holds(record):
    still = record.values["changes"]["none"]["field"]["error_cm"]
    assert distance(still) in rooms.finding(record)
    table = rooms.table(record, "field")
    assert table["mean error"][0] == distance(still) and len(table) == len(record.values["changes"])
    line = rooms.errors(record).axes[0].containers[rooms.METHODS.index("field")][0]
    assert still["value"] in np.asarray(line.get_xdata(), float)


def test_a_shadow_and_a_rug_change_their_part_of_the_floor_only():
    floor = colourful_floor()
    before = floor.picture.image.astype(int)
    shaded = rooms.changed_floor(floor, rooms.CHANGES["shadow"]).picture.image
    half = before.shape[1] // 2
    np.testing.assert_array_equal(shaded[:, half:], before[:, half:])
    np.testing.assert_allclose(shaded[:, :half], rooms.SHADE * before[:, :half], atol=1)
    laid = (rooms.changed_floor(floor, rooms.CHANGES["rug"]).picture.image != before).any(axis=2)
    assert laid.mean() == pytest.approx(rooms.RUG_SHARE, abs=0.01)


def test_a_frame_counts_as_after_the_rug_two_seconds_after_it_left_the_view():
    shown = np.array([0, 1, 0, 0, 1, 0, 0, 0], bool)
    np.testing.assert_array_equal(np.flatnonzero(rooms._left(shown, np.arange(8.0))), [3, 6, 7])


def test_a_flight_without_a_floor_is_refused(flight):
    with pytest.raises(ParameterError, match="no picture of its floor or no camera"):
        rooms.run(replace(flight, camera=None), flight, rooms.Parameters())
