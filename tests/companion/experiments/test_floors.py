"""Judging floors from pictures, on small flights."""

from __future__ import annotations

import json
import pickle
from argparse import Namespace
from dataclasses import replace
from functools import partial

import cv2
import numpy as np
import pytest
from conftest import small_flight

from trexton.base.errors import ImageError, ParameterError
from trexton.base.records import Record
from trexton.cli.main import main
from trexton.companion.cli import suitability as command
from trexton.companion.executor import spreading, working_on
from trexton.companion.experiments import suitability, virtual_flights
from trexton.companion.experiments.floors import named_floor
from trexton.companion.experiments.suitability import measured_over_predicted, predicted_errors
from trexton.companion.experiments.virtual_flights import (
    VirtualFlights,
    first_prediction,
    judge_floor,
    measured_cm,
    predictions,
)
from trexton.localization.localizer import Localizer
from trexton.localization.training import train_map
from trexton.simulator.floor import Floor
from trexton.simulator.recording import record_flight
from trexton.vision.camera import Camera
from trexton.vision.threads import usable_cores

SMALL = VirtualFlights(frames=100, test_frames=30)
LATER, MEASURED = 2, 1


@pytest.fixture(scope="module", autouse=True)
def small_flights():
    """A sixteenth of the pixels, few textons and patches, and few flights after each survey."""

    def smaller(*arguments, camera, **more):
        return record_flight(*arguments, camera=Camera(160, 120, 130.0), **more)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(virtual_flights, "record_flight", smaller)
        patch.setattr(virtual_flights, "train_map", partial(train_map, n_textons=8))
        patch.setattr(virtual_flights, "Localizer", partial(Localizer, samples=200))
        patch.setattr(virtual_flights, "LATER", LATER)
        patch.setattr(virtual_flights, "MEASURED", MEASURED)
        yield


@pytest.fixture(scope="module")
def picture(tmp_path_factory):
    rng = np.random.default_rng(4)
    coarse = rng.uniform(20, 235, (9, 9, 3)).astype(np.float32)
    image = cv2.resize(coarse, (300, 300), interpolation=cv2.INTER_CUBIC)
    path = tmp_path_factory.mktemp("floor") / "floor.png"
    cv2.imwrite(str(path), np.clip(image + rng.normal(0, 20, image.shape), 0, 255))
    return path


@pytest.fixture(scope="module")
def floor(picture):
    return Floor.from_file(picture, 3.0)


@pytest.fixture(scope="module")
def predicted(floor):
    """A first number, and the floor as it is judged."""
    return tuple(predictions(floor, flights=SMALL))


@pytest.fixture(scope="module")
def judged(predicted):
    return predicted[1]


@pytest.fixture(scope="module")
def tiny(picture):
    """A floor that is judged within a second, and how."""
    given = Floor.from_file(picture, 1.0), VirtualFlights(frames=25, test_frames=20)
    return *given, judge_floor(given[0], flights=given[1])


@pytest.fixture(scope="module")
def measured(floor):
    return measured_cm(
        floor, flights=replace(SMALL, seed=900, test_frames=60), methods=("field", "paper")
    )


def test_a_floor_is_judged_by_flights_of_the_method(judged):
    assert judged["frames"] == {"survey": 100, "test": 30 * LATER}
    assert 0 < judged["low"] <= judged["predicted_cm"] <= judged["high"] < judged["centre_cm"]
    assert judged["heat"]["error_m"].shape == (30, 30)


def test_other_flights_after_another_survey_err_by_as_much(judged, measured):
    errors, places = measured
    assert list(errors) == ["field", "paper"] and len(places) == 60 * MEASURED
    assert 0.5 < errors["field"].mean() / judged["predicted_cm"] < 2


def test_hard_places_are_those_worse_than_the_mean(picture, tmp_path):
    half = cv2.imread(str(picture))
    half[:, 170:] = 128  # there one place is as the next
    cv2.imwrite(str(tmp_path / "half.png"), half)
    floor = Floor.from_file(tmp_path / "half.png", 3.0)
    judged = judge_floor(floor, flights=SMALL)
    heat, mean = judged["heat"]["error_m"], judged["predicted_cm"] / 100
    x, y = judged["worst_m"]
    assert heat[int(y / 0.1), int(x / 0.1)] == heat.max() > mean and x > 1.7
    hard = heat > mean
    assert hard[:, 18:].mean() > hard[:, :16].mean()
    line = predicted_errors(floor, judged).axes[0].collections[0]
    assert line.levels == [pytest.approx(100 * mean)]


def test_a_first_number_is_of_the_same_size(predicted):
    first, judged = predicted
    assert judged["predicted_cm"] / 4 < first < 4 * judged["predicted_cm"]


def test_both_are_what_they_are_by_themselves_though_drawn_beside_one_another(tiny):
    floor, flights, judged = tiny
    first, whole = predictions(floor, flights=flights)
    assert first == first_prediction(floor, flights=flights)
    assert whole["predicted_cm"] == judged["predicted_cm"]


def test_later_halves_of_flights_stand_for_what_would_follow():
    errors_cm = np.array([[8.0, 4.0, 2.0, 1.0], [5.0, 3.0, 0.0, 6.0]])
    places = np.arange(16.0).reshape(8, 2)
    longer, there = virtual_flights._prolonged(errors_cm, places)
    np.testing.assert_array_equal(longer[0], [8, 4, 2, 1, 2, 1, 2, 1])
    np.testing.assert_array_equal(longer[1], [5, 3, 0, 6, 0, 6, 0, 6])
    assert there.shape == (16, 2)
    np.testing.assert_array_equal(there[[0, 6, 7, 15]], places[[0, 2, 3, 7]])


def test_equal_seeds_judge_equally(tiny, picture):
    _, flights, first = tiny
    again = judge_floor(Floor.from_file(picture, 1.0), flights=flights)
    assert first["predicted_cm"] == again["predicted_cm"]
    np.testing.assert_array_equal(first["heat"]["error_m"], again["heat"]["error_m"])


def test_names_of_painted_floors():
    assert named_floor("hall:4").area == (0, 5, 0, 5)
    for name in ("few", "few:x", "attic:1", "few.png@", "few.png@wide"):
        with pytest.raises(ParameterError):
            named_floor(name)


def test_pictures_are_named_with_their_width(picture, monkeypatch):
    monkeypatch.setenv("TREXTON_DATA", str(picture.parent))
    assert named_floor("floor.png@3").area == named_floor(f"{picture}@3.0").area == (0, 3, 0, 3)
    with pytest.raises(ImageError, match="other.png"):
        named_floor("other.png@3")


ROWS = [
    {
        "predicted_cm": p,
        "field_cm": m,
        "loss": loss,
        "paper_cm": 3 * m,
        "centre_cm": 200.0,
        "hard_cm": m + p,
    }  # fmt: skip
    for p, m, loss in ((10, 12, 0.3), (20, 18, 0.2), (40, 100, 0.1), (30, 33, 0.4), (50, 200, 0.0))
]


def said_of(validation):
    return suitability.finding(Record("suitability", "f", {}, {"validation": validation}))


def test_a_prediction_is_judged_by_order_and_by_centimetres():
    found = suitability.validation(ROWS, seed=1)
    assert found["count"] == 5 and found["rank"]["value"] == pytest.approx(1)
    # Ranks of the loss: 4 3 2 5 1 against 1 2 4 3 5, so 1 - 6 (9 + 1 + 4 + 4 + 16) / (5 * 24).
    assert found["loss_rank"]["value"] == pytest.approx(-0.7)
    assert found["loss_rank"]["low"] < -0.7 < found["loss_rank"]["high"]
    assert found["ratio"] == pytest.approx(1.2) and found["level"] == pytest.approx(3 / 5)
    # Ratios 1.2, .9, 2.5, 1.1, 4; hard over measured 1.83, 2.11, 1.4, 1.91, 1.25.
    assert found["off"] == pytest.approx(0.2) and found["twice"] == pytest.approx(3 / 5)
    assert found["hard"] == pytest.approx(22 / 12)
    said = said_of(found)
    assert "5 floors" in said and "1.00 (too few floors for an" in said and "-0.70 [" in said
    assert "on 60 % of the floors" in said and "a factor of two on 60 %" in said
    one = said_of(suitability.validation(ROWS[:1], seed=1))
    assert "nan" not in one and "–" in one


def test_a_kept_sweep_reads_as_the_run_does():
    rows = [
        {"floors": f"few:{i}", "flight": "f"} | {f"mean.{key}": v for key, v in row.items()}
        for i, row in enumerate(ROWS)
    ]
    kept = suitability.kept_rows({"rows": rows})
    assert list(kept.values()) == ROWS and suitability.kept_rows(None) == {}
    one, many = (
        measured_over_predicted({"a.png@3": ROWS[0]}, {}),
        measured_over_predicted({"a.png@3": ROWS[0]}, kept),
    )
    points = [sum(len(line.get_xdata()) for line in each.axes[1].lines) for each in (one, many)]
    assert points == [1, 6]


def test_floors_are_predicted_and_flown(picture):
    floors = f"{picture}@1.5 {picture}@1"
    given = suitability.Parameters(floors=floors, frames=25, test_frames=20)
    flight = small_flight()
    record = suitability.run(flight, flight, given)
    rows = record.values["floors"]
    assert list(rows) == floors.split()
    for row in rows.values():
        assert set(ROWS[0]) < set(row) and row["predicted_cm"] > 0
        assert row["survey_frames"] == 25 and row["test_frames"] == 20 * LATER
    assert record.values["mean"]["field_cm"] == np.mean([row["field_cm"] for row in rows.values()])
    assert suitability.finding(record).startswith("Over 2 floors")


@pytest.fixture
def here(monkeypatch):
    """Pictures are judged in this process, where cameras are small; what others would be sent is
    sent. How many processes were asked for.
    """
    asked = []

    def alone(processes):
        asked.append(processes)
        return working_on(1)

    def sent(function, steps, label):
        return spreading(pickle.loads(pickle.dumps(function)), steps, label)

    monkeypatch.setattr(command, "working_on", alone)
    monkeypatch.setattr(command, "spreading", sent)
    return asked


def test_the_command_ranks_floors_and_writes_what_it_found(picture, tmp_path, capsys, here):
    grey = tmp_path / "grey.png"
    cv2.imwrite(str(grey), np.repeat([[126], [132]], 150, axis=0).repeat(300, axis=1))
    words = ["suitability", str(grey), str(picture), "--width", "1", "--frames", "30"]
    assert main([*words, "--test-frames", "20", "--out", str(tmp_path / "out")]) == 0
    assert here == [min(2, usable_cores())]  # side by side
    said = capsys.readouterr()
    assert said.err.count("cm by first, coarse flights") == 2
    lines = said.out.splitlines()
    assert [line[0] for line in lines if not line.startswith(" ")] == ["1", "2"]
    assert sum("hardest place" in line for line in lines) == 2
    content = json.loads((tmp_path / "out" / "grey.json").read_text())
    hopeless = content["predicted_cm"] >= content["centre_cm"]
    said = next(line for line in lines if str(grey) in line)
    assert ("it will not do" in lines[lines.index(said) + 1]) == hopeless
    content = json.loads((tmp_path / "out" / "floor.json").read_text())
    assert content["predicted_cm"] > 0 and (tmp_path / "out" / "floor.png").stat().st_size > 10_000


def test_no_picture_and_no_other_floor_is_written_over(picture, tmp_path, capsys):
    before = picture.read_bytes()
    words = ["suitability", "--width", "2", "--out"]
    assert main([*words, str(picture.parent), str(picture)]) == 1
    assert "is read here" in capsys.readouterr().err
    assert picture.read_bytes() == before and not picture.with_suffix(".json").exists()
    namesake = tmp_path / "other" / f"{picture.stem}.jpg"
    namesake.parent.mkdir()
    cv2.imwrite(str(namesake), np.repeat([[126], [132]], 150, axis=0).repeat(300, axis=1))
    assert main([*words, str(tmp_path / "out"), str(picture), str(namesake)]) == 1
    assert "would both be written" in capsys.readouterr().err and not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ([], "width"),
        (["--width", "3", "--seed", "-1"], "seed"),
    ],
)
def test_what_is_missing_is_said(picture, capsys, more, words):
    assert main(["suitability", str(picture), *more]) == 1
    assert words in capsys.readouterr().err


@pytest.mark.parametrize(("pixels", "said"), [(300, ""), (200, "40 pixels a metre")])
def test_a_picture_coarser_than_a_camera_is_said(tmp_path, capsys, pixels, said):
    """Two pixels by two gave a floor of 27 cm, and no word."""
    values = np.random.default_rng(1).integers(0, 255, (pixels, pixels, 3), np.uint8)
    cv2.imwrite(str(tmp_path / "p.png"), values)
    command._floor(str(tmp_path / "p.png"), Namespace(width=5.0))
    shown = capsys.readouterr().err
    assert said in shown and bool(said) is bool(shown)


def test_what_may_be_no_better_than_the_middle_is_said(picture, capsys, monkeypatch):
    answer = {"predicted_cm": 135, "low": 82, "high": 205, "centre_cm": 151, "worst_m": (1, 2)}
    answers = iter([None, answer | {"loss": 0.1}])
    monkeypatch.setattr(virtual_flights, "predictions", lambda *floors, flights: answers)
    assert main(["suitability", str(picture), "--width", "5"]) == 0
    assert "it may not do: that is not clearly better" in capsys.readouterr().out
