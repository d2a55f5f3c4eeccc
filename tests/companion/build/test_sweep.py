"""Sweeps: all combinations once, reused while nothing changed, one table at the end."""

from __future__ import annotations

import json
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace

import pandas as pd
import pytest
from conftest import ROOT, small_flight

from trexton.base.errors import ParameterError
from trexton.cli import main as cli
from trexton.companion.build.flight_pairs import FlightPair, check_out
from trexton.companion.build.sweep import SweepPlan, sweep
from trexton.flights.writing import write_flight


@pytest.fixture
def flight(tmp_path):
    write_flight(small_flight(), tmp_path / "room")
    return str(tmp_path / "room")


@pytest.fixture
def in_place(monkeypatch):
    """Called, cells are run in this process, which is quick; other tests start processes."""

    def here(do, *words):
        return do(*words)

    def callers(cluster, jobs):
        assert cluster is None and jobs in (None, 1)
        return nullcontext((1, here, lambda: None))

    return lambda: monkeypatch.setattr("trexton.companion.build.sweep.callers", callers)


SETTINGS = {"particles": ["5", "7"], "seed": [1, 2], "repeats": [1], "neighbors": [2]}


def test_every_combination_is_run_once_and_then_reused(flight, tmp_path, in_place):
    plan = SweepPlan("mocap_training", SETTINGS, [FlightPair(flight)])
    swept = sweep(plan, tmp_path / "out", jobs=2)
    assert swept.counts == {"ran": 4, "reused": 0, "failed": 0}, swept.failed
    table = pd.read_csv(tmp_path / "out" / "sweep.csv")
    assert list(table.columns)[:5] == ["flight", *SETTINGS]
    assert sorted(zip(table.particles, table.seed, strict=True)) == [(5, 1), (5, 2), (7, 1), (7, 2)]
    assert table["filter.mean_cm.value"].nunique() == 4
    before = (tmp_path / "out" / "sweep.json").read_bytes()
    in_place()
    half = SweepPlan("mocap_training", SETTINGS | {"particles": ["7"]}, [FlightPair(flight)])
    found = sweep(half, tmp_path / "again", jobs=1).rows
    assert found == [row for row in swept.rows if row["particles"] == 7], "two sweeps, one result"

    again = sweep(plan, tmp_path / "out", jobs=1)
    assert again.counts == {"ran": 0, "reused": 4, "failed": 0}
    assert (tmp_path / "out" / "sweep.json").read_bytes() == before
    wider = SETTINGS | {"particles": [7, 9], "seed": [1]}
    plan = SweepPlan("mocap_training", wider, [FlightPair(flight)])
    assert sweep(plan, tmp_path / "out", jobs=1).counts == {"ran": 1, "reused": 1, "failed": 0}


def test_the_table_holds_every_number_and_no_times(flight, tmp_path, in_place):
    in_place()
    plan = SweepPlan("timing", {"neighbors": [2], "passes": [1]}, [FlightPair(flight)])
    swept = sweep(plan, tmp_path / "out", jobs=1)
    assert swept.rows[0]["counts.test"] == 20 and swept.rows[0]["camera_hz"] > 0
    table = (tmp_path / "out" / "sweep.csv").read_text()
    assert "timings" not in table and "total_ms" not in table
    (cell,) = (tmp_path / "out" / "cells" / "small").iterdir()
    assert json.loads(cell.read_text())["timings"]["total_ms"]["median"] > 0


def test_a_cell_runs_again_when_the_code_of_an_own_experiment_changed(
    flight, tmp_path, in_place, monkeypatch
):
    in_place()
    module = tmp_path / "own_sweep.py"
    source = (ROOT / "tests" / "tiny_experiment.py").read_text().replace(
        'raise NotImplementedError("a tiny notebook makes its record itself")',
        "return Record('own_sweep', train.name, parameters.as_dict(), {'n': 1})",
    ) + "EXPERIMENT = tiny('My own')\n"  # fmt: skip
    module.write_text(source)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("TREXTON_PLUGINS", "own_sweep")
    plan = SweepPlan("own_sweep", {}, [FlightPair(flight)])
    counts = [sweep(plan, tmp_path / "out", jobs=1).counts["ran"] for _ in "ab"]
    module.write_text(source + "# edited\n")
    assert [*counts, sweep(plan, tmp_path / "out", jobs=1).counts["ran"]] == [1, 0, 1]


def test_the_plan_is_a_file(flight, tmp_path, capsys, in_place):
    in_place()
    plan = tmp_path / "plan.toml"
    plan.write_text(
        f'experiment = "mocap_training"\nflights = ["{flight}"]\n'
        "[set]\nparticles = [6]\nrepeats = 1\nneighbors = 2\n"
    )
    out = tmp_path / "out"
    assert cli.main(["sweep", str(plan), "--out", str(out), "--quiet"]) == 0
    assert capsys.readouterr().out.splitlines()[0] == "1 ran"
    (row,) = json.loads((out / "sweep.json").read_text())["rows"]
    expected = {"flight": "small", "particles": 6, "repeats": 1, "neighbors": 2, "counts.test": 20}
    assert row | expected == row


@pytest.mark.parametrize("name", ["book", "report.html"])
def test_a_flight_named_as_a_result_is_refused(name, tmp_path):
    pairs = [SimpleNamespace(name="room"), SimpleNamespace(name=name)]
    with pytest.raises(ParameterError, match=f"named '{name}', as a result is"):
        check_out(tmp_path, pairs)


def test_results_into_a_file_are_refused_before_the_work(flight, tmp_path, capsys):
    (out := tmp_path / "out").write_text("mine")
    assert cli.main(["report", flight, "--no-book", "--out", str(out)]) != 0
    said = capsys.readouterr()
    assert not said.out and f"{out} is no folder" in said.err


def test_two_flights_of_one_name_are_refused(flight, tmp_path):
    """Each row would tell the results of whichever was flown last."""
    write_flight(replace(small_flight(), time=small_flight().time * 2), tmp_path / "other")
    pairs = [FlightPair(flight), FlightPair(str(tmp_path / "other"))]
    with pytest.raises(ParameterError, match="two flights are named 'small'"):
        sweep(SweepPlan("mocap_training", SETTINGS, pairs), tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("set = 3", "set is 3: expected a table"),
        ('test_flight = ["a"]', "test_flight is ['a']: expected str or None"),
        ('flights = "hall"', "flights is 'hall': expected a list of texts"),
        ("flights = [3]", "flights is [3]: expected a list of texts"),
        ('experiment = ["light"]', "experiment is ['light']: expected str"),
        ('flights = ["ROOM"]\n[set]\nseed = []', "seed has no values to sweep"),
    ],
)
def test_a_plan_with_other_things_in_it_is_refused(flight, tmp_path, capsys, line, message):
    """Letters of a word are no list of flights, and nothing is run before all is read."""
    plan, out = tmp_path / "plan.toml", tmp_path / "out"
    named = "" if line.startswith("experiment") else 'experiment = "mocap_training"\r\n'
    plan.write_text(named + line.replace("ROOM", flight), encoding="utf-8-sig")
    assert cli.main(["sweep", str(plan), "--out", str(out), "--quiet"]) == 1
    assert message in capsys.readouterr().err and not out.exists()


def test_a_cell_that_fails_costs_only_itself(flight, tmp_path, capsys, in_place):
    in_place()
    plan = SweepPlan("texton_dictionary", {"textons": [6, 8]}, [FlightPair(flight)])
    with pytest.raises(ParameterError, match="texton_dictionary cannot run: small has no images"):
        sweep(plan, tmp_path / "out")
    settings = SETTINGS | {"neighbors": [10**6, 2], "seed": [1], "particles": ["5"]}
    plan = SweepPlan("mocap_training", settings, [FlightPair(flight)])
    swept = sweep(plan, tmp_path / "out", jobs=1)
    assert swept.counts == {"ran": 1, "reused": 0, "failed": 1}
    assert len(swept.rows) == 1 and all("1000000" in reason for reason in swept.failed.values())
    file = tmp_path / "plan.toml"
    file.write_text(
        f'experiment = "mocap_training"\nflights = ["{flight}"]\n[set]\nparticles = ["5"]\n'
        "seed = 1\nrepeats = 1\nneighbors = [1000000, 2]\n"
    )
    capsys.readouterr()
    assert cli.main(["sweep", str(file), "--out", str(tmp_path / "out"), "--quiet"]) == 1
    said = capsys.readouterr()
    assert said.err.count("failed  ") == 1 and said.out.startswith("1 reused, 1 failed\n")
    table = (tmp_path / "out" / "sweep.csv").read_bytes()
    none = replace(plan, settings=plan.settings | {"neighbors": [1000000]})
    assert not sweep(none, tmp_path / "out", jobs=1).rows
    assert (tmp_path / "out" / "sweep.csv").read_bytes() == table


@pytest.mark.parametrize(
    ("plan", "message"),
    [
        ('experiment = "moon"', "no experiment 'moon' to sweep: there are"),
        ('experiment = "mocap_training"', "a sweep needs flights: name some"),
        ("", "no experiment '' to sweep"),
        ("moon = 1", "a plan has no parameter 'moon'"),
        (
            'experiment = "timing"\nflights = ["ROOM"]\n[set]\nmoon = 1',
            "timing has no parameter 'moon'",
        ),
        (
            'experiment = "timing"\nflights = ["ROOM"]\n[set]\npasses = 0',
            "passes is 0: expected 1 or more",
        ),
        (None, "plan.toml: cannot be read"),
    ],
)
def test_nonsense_is_refused_before_anything_is_touched(flight, tmp_path, capsys, plan, message):
    file = tmp_path / "plan.toml"
    if plan is not None:
        file.write_text(plan.replace("ROOM", flight))
    assert cli.main(["sweep", str(file), "--out", str(tmp_path / "out"), "--quiet"]) == 1
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
