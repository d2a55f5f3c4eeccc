"""What the autopilot knows: the experiment that compares it with the frame alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from onboard_tools import colourful_flight

from trexton.base.errors import ParameterError
from trexton.companion.experiments import aiding
from trexton.companion.experiments.floors import mean_over_floors

CHOSEN = {"survey": 40, "frames": 20, "textons": 6, "samples": 100}


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    folder = tmp_path_factory.mktemp("aiding") / "flight"
    return colourful_flight(folder)


@pytest.fixture(scope="module")
def record(flight):
    return aiding.run(flight, flight, aiding.Parameters(**CHOSEN))


def test_the_record_compares_all_with_the_frame_alone(record):
    values = record.values
    for method, asked in aiding.METHODS.items():
        errors, gains = values["error_cm"][method], values["gain_cm"][method]
        assert list(errors) == list(asked)
        for known, gain in gains.items():
            saved = errors["nothing"]["value"] - errors[known]["value"]
            assert gain["value"] == pytest.approx(saved)
            assert gain["low"] <= gain["value"] <= gain["high"]
    assert values["frames"] == 20 and values["floors"] == 1
    assert set(values["held"]) == {"velocity", "turned"}
    assert all(0 <= share["value"] <= 1 for share in values["held"].values())


def test_finding_table_and_figure_say_what_the_record_holds(record):
    sentences = aiding.finding(record)
    sure = record.values["gain_cm"]["field"]["velocity"]["low"] > 0
    assert (" (less, beyond chance). With one that" in sentences) == sure
    assert "a compass turns by 20 degrees" in sentences
    table = aiding.table(record)
    assert list(table.iloc[:, 0]) == list(aiding.AIDINGS.values())
    assert table.iloc[1, 1] == ""  # the paper's filter takes no velocity
    assert len(aiding.errors(record).axes[0].get_yticklabels()) == len(aiding.AIDINGS)


def test_a_flight_without_a_floor_is_told_so(flight):
    with pytest.raises(ParameterError, match="no picture of its floor"):
        bare = replace(flight, camera=None)
        aiding.run(bare, bare, aiding.Parameters(**CHOSEN))


def test_an_interval_over_floors_is_as_wide_as_so_few_floors_ask():
    rng = np.random.default_rng(1)
    alike = 5 + np.repeat(rng.normal(size=(4, 1)), 300, axis=1)  # floors differ, frames do not
    wide = mean_over_floors(alike, np.random.default_rng(2))
    error = alike[:, 0].std(ddof=1) / 2  # of the mean of four
    assert wide["high"] - wide["low"] > 2 * 1.96 * error


def test_of_one_floor_the_interval_is_over_stretches_of_its_flight():
    rows = np.random.default_rng(1).random((1, 300))
    found = mean_over_floors(rows, np.random.default_rng(2))
    assert found["low"] < found["value"] == rows.mean() < found["high"]
