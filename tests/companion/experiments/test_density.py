"""How densely to survey: the experiment that flies closer and closer lanes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from onboard_tools import CAMERA, colourful_flight

from trexton.base.errors import ParameterError
from trexton.companion.build import notebook
from trexton.companion.experiments import density, floors
from trexton.companion.wording import distance

CHOSEN = {"survey": 20, "frames": 20, "textons": 6, "samples": 100}


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    return colourful_flight(tmp_path_factory.mktemp("density") / "flight", frames=10)


@pytest.fixture(scope="module")
def record(flight):
    return density.run(flight, flight, density.Parameters(**CHOSEN))


def test_longer_surveys_come_nearer(record):
    surveys = record.values["surveys"]
    assert [survey["frames"] for survey in surveys] == [20, 40, 80]
    apart, lasted = ([each[key] for each in surveys] for key in ("apart_cm", "lasted_s"))
    assert apart == sorted(apart, reverse=True) and lasted == sorted(lasted)
    for survey in surveys:
        for method in density.METHODS:
            error = survey[method]["error_cm"]
            assert 0 < error["low"] <= error["value"] <= error["high"]
            assert 0 <= survey[method]["held"] <= 1


def test_equal_seeds_give_equal_records(flight, record, monkeypatch):
    monkeypatch.setattr(density, "TIMES", density.TIMES[:1])  # of which the longer know nothing
    again = density.run(flight, flight, density.Parameters(**CHOSEN))
    assert again.values == record.values | {"surveys": record.values["surveys"][:1]}


def test_finding_table_and_figure_say_what_the_record_holds(record):
    surveys = record.values["surveys"]
    parts, whole = (surveys[0][method]["error_cm"] for method in ("parts", "field"))
    words = f"{distance(parts)} by parts of the images, {distance(whole['value'])} by whole ones"
    assert words in density.finding(record)
    assert len(density.table(record)) == len(density.TIMES) * len(density.METHODS)
    (plot,) = density.errors(record).axes
    drawn, *_ = plot.containers[0]
    np.testing.assert_allclose(
        np.asarray(drawn.get_xdata(), float), [survey["apart_cm"] for survey in surveys]
    )


def test_the_long_run_is_kept_and_can_be_shown():
    kept = notebook.reference("density")
    assert kept is not None and kept.values["floors"] == 10
    assert density.finding(kept).startswith("After a survey of")
    assert len(density.table(kept)) == len(kept.values["surveys"]) * len(density.METHODS)
    assert len(density.errors(kept).axes[0].containers) == len(density.METHODS)


def test_painted_floors_are_other_floors(flight, record, monkeypatch):
    monkeypatch.setattr(floors, "Camera", lambda: CAMERA)
    monkeypatch.setattr(density, "FIRST_FLOOR", 0)  # which other tests paint too
    monkeypatch.setattr(density, "TIMES", density.TIMES[:1])
    painted = density.run(flight, flight, density.Parameters(floors=1, **CHOSEN)).values
    assert painted["floors"] == 1
    assert painted["surveys"][0]["apart_cm"] != record.values["surveys"][0]["apart_cm"]


def test_a_flight_without_a_floor_is_told_so(flight):
    bare = replace(flight, camera=None)
    with pytest.raises(ParameterError, match="no picture of its floor"):
        density.run(bare, bare, density.Parameters(**CHOSEN))
