"""Experiment ``fine``: virtual floors and kidnappings."""

from __future__ import annotations

from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from trexton.companion.build import notebook
from trexton.companion.experiments import fine
from trexton.companion.experiments.floors import painted_floor
from trexton.companion.experiments.rates import wilson_interval
from trexton.simulator.recording import record_flight
from trexton.simulator.simulator import Simulator
from trexton.vision.camera import Camera


@pytest.fixture(scope="module")
def record(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        flight = record_flight(
            tmp_path_factory.mktemp("flights") / "again",
            pattern="waypoints", frames=34, camera=Camera(160, 120, 130.0),
        )  # fmt: skip
        # Stitching has tests of its own, and a camera of fewer pixels is as good.
        camera = Camera(320, 240, 260.0)
        patch.setattr(fine, "Simulator", partial(Simulator, camera=camera))
        # A floor that other tests paint too.
        patch.setattr(fine, "painted_floor", lambda number, seed: painted_floor(number, 4002))
        patch.setattr(fine, "stitched_map", lambda train: SimpleNamespace(map=train.floor))
        parameters = fine.Parameters(floors=1, frames=50, training=50, kidnappings=1)
        return fine.run(flight, flight, parameters)


def test_errors_are_centimetres_everywhere(record):
    for where in ("surveyed", "stitched"):
        for name in fine.ATTITUDES:
            mean = record.values["flight"][where][name]["mean_cm"]
            assert 0 < mean["low"] < mean["value"] < mean["high"] < 10
            assert max(record.series[f"{where}_{name}_cm"][fine.SETTLED :]) < 10
    for name in fine.ATTITUDES:
        entry = record.values["all"][name]
        assert entry["frames"] == 25 and entry["gross"] == 0 and entry["mean_cm"] < 2
        assert 0 <= entry["region_90"] <= 1 and entry["p95_cm"] <= entry["max_cm"]


def test_a_kidnapped_vehicle_is_localized_again(record):
    assert record.values["kidnapped"]["found_rate"]["value"] == 1
    assert record.timings["free"]["median_s"] > 0


def test_the_finding_says_what_the_record_holds(record):
    text = fine.finding(record)
    assert f"{record.values['all']['free']['gross']} of 75 frames" in text


def test_floors_of_the_finding_are_the_long_run_s_and_the_flight_its_own(record):
    kept = notebook.reference("fine")
    text = fine.finding(record, kept)
    own, long = fine.finding(record).split(". On a"), fine.finding(kept).split(". On a")
    assert text == f"{long[0]}. On a{own[1]}" and own[0] != long[0]


def test_figures_draw_the_record(record):
    assert all(axes.lines for axes in fine.over_time(record).axes)


def test_kidnappings_over_one_floor_count_together():
    assert fine.found_rate([None], 1)["value"] == 0
    rate = fine.found_rate([1] * 40, 4)
    assert rate["trials"] == 40 and rate["clusters"] == 4
    alone = wilson_interval(4, 4)  # all alike: a floor counts once
    assert (rate["low"], rate["high"]) == alone


def test_means_over_floors_are_those_of_all_frames():
    kept = notebook.reference("fine")
    for name in fine.ATTITUDES:
        for quantity, highest in (("mean_cm", np.inf), ("region_90", 1)):
            found, pooled = fine.over_floors(kept, name, quantity, highest), kept.values["all"]
            assert found["value"] == pytest.approx(pooled[name][quantity])
            assert found["low"] < found["value"] < found["high"]
