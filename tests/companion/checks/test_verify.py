"""Verification: what changed is found and named, what did not is left in peace."""

import json
import os
from pathlib import Path
from types import SimpleNamespace

import pytest
from conftest import small_flight

from trexton.base.errors import TrextonError
from trexton.base.records import SCHEMA
from trexton.cli.main import main
from trexton.companion.checks import verify as module
from trexton.companion.checks.verify import differences, references, update, verify
from trexton.companion.experiments import mocap_training
from trexton.flights import write_flight

VALUES = {"error_cm": 12.5, "frames": 40, "ranks": [1.0, 2.0]}


def saved(path, **changes):
    """A record's file with a recipe of flights that nobody will fly."""
    content = {
        "schema": SCHEMA,
        "experiment": "mocap_training",
        "flight": "train",
        "parameters": {},
        "values": VALUES,
        "series": {},
        "images": {},
        "timings": {},
        "provenance": {
            "flights": {"train": "ab"},
            "versions": {"numpy": "1.0"},
            "simulated": {},
        },
    } | changes
    path.write_text(json.dumps(content))
    return path


@pytest.fixture
def again(monkeypatch):
    """Experiments that come out as the record they are given."""
    told = SimpleNamespace(record={}, caches=[], flights=[])

    def rebuild(name, parameters, flights, out):
        told.caches.append(os.environ["TREXTON_CACHE"])
        told.flights.append(flights)
        out.mkdir(parents=True, exist_ok=True)
        return json.loads(saved(out / f"{name}.json", **told.record).read_text())

    monkeypatch.setattr(module, "rebuild", rebuild)
    return told


def test_what_is_as_it_was_holds(again, tmp_path):
    verdict = verify(saved(tmp_path / "r.json"), tmp_path, "flight")
    assert verdict.changes == []
    (cache,) = again.caches
    assert not Path(cache).exists() and os.environ.get("TREXTON_CACHE") != cache


def test_a_changed_number_is_found_and_named_with_the_version_that_moved(again, tmp_path):
    path = saved(tmp_path / "r.json")
    again.record = {"values": VALUES | {"error_cm": 12.5 * (1 + 2e-9), "frames": 41}}
    verdict = verify(path, tmp_path, "flight")
    assert [line.split(":")[0] for line in verdict.changes] == ["values.error_cm", "values.frames"]
    assert "values.frames: 40 -> 41" in verdict.changes
    assert any(line.startswith("numpy: '1.0' -> ") for line in verdict.versions)


def test_other_data_are_named(again, tmp_path):
    again.record = {"provenance": {"flights": {"train": "cd"}}}
    verdict = verify(saved(tmp_path / "r.json"), tmp_path, "flight")
    assert verdict.changes == ["data of flight.train: 'ab' -> 'cd'"]


def test_flights_simulated_anew_are_judged_by_their_values(again, tmp_path, monkeypatch):
    """Their last bits are the processor's; two records of one recipe share a flight."""
    made = []

    def record_flight(folder, **recipe):
        made.append(recipe)
        folder.mkdir(parents=True)

    monkeypatch.setattr("trexton.simulator.record_flight", record_flight)
    recipe = {"train": {"frames": 3, "seed": 1}, "test": {"frames": 3, "seed": 2}}
    again.record = {"provenance": {"flights": {"train": "cd"}}}
    for name in ("one", "two"):
        path = saved(tmp_path / f"{name}.json")
        content = json.loads(path.read_text())
        content["provenance"]["simulated"] = recipe
        path.write_text(json.dumps(content))
        assert verify(path, tmp_path).changes == []
    assert made == [recipe["train"], recipe["test"]]
    folders = again.flights[0]
    assert [Path(folder).name for folder in folders] == ["train", "test"]
    assert again.flights[-1] == folders


@pytest.mark.parametrize(("factor", "changes"), [(1 + 1e-12, 0), (1 + 1e-8, 1)])
def test_other_kernels_may_round_otherwise_but_no_more(again, tmp_path, factor, changes):
    again.record = {"values": VALUES | {"error_cm": 12.5 * factor}}
    assert len(verify(saved(tmp_path / "r.json"), tmp_path, "flight").changes) == changes


def test_the_command_shows_the_difference_and_updates_when_told(again, tmp_path, capsys):
    path = saved(tmp_path / "r.json")
    before = path.read_bytes()
    many = {"values": VALUES | {str(n): n for n in range(30)}, "series": {"track": [1.0]}}
    again.record = many
    words = ["verify", str(path), "--flight", "flight"]
    assert main(words) == 1
    shown = capsys.readouterr().out
    assert "absent -> 0" in shown and "and 10 more" in shown and "numpy: '1.0' ->" in shown
    assert path.read_bytes() == before
    assert main([*words, "--update"]) == 0
    new = json.loads(path.read_text())
    assert new["values"] == many["values"] and new["provenance"]["simulated"] == {}
    assert new["series"] == {}  # a reference stays small
    capsys.readouterr()
    assert main(words) == 0
    assert "as it was" in capsys.readouterr().out


def test_results_of_runs_are_not_updated(again, tmp_path):
    provenance = {"flights": {"train": "ab"}}
    path = saved(tmp_path / "r.json", provenance=provenance)
    again.record = {"values": {}}
    with pytest.raises(TrextonError, match="run its experiment again"):
        update(verify(path, tmp_path, "flight"))


def test_faults_are_one_clear_error(again, tmp_path, monkeypatch):
    path = saved(tmp_path / "r.json", provenance={"flights": {"train": "ab"}})
    with pytest.raises(TrextonError, match="train: name their folders with --flight"):
        verify(path, tmp_path)
    for text in ("{", "[]", '{"parameters": {}}', '{"parameters": 1, "provenance": {}}'):
        path.write_text(text)
        with pytest.raises(TrextonError, match="not a readable record"):
            verify(path, tmp_path, "flight")
    monkeypatch.setattr(module, "kept_results", lambda: [])
    with pytest.raises(TrextonError, match="name a record"):
        references()


@pytest.mark.parametrize("experiment", ["claims", "nobody"])
def test_only_experiments_on_flights_are_run_again(experiment, tmp_path):
    path = saved(tmp_path / "r.json", experiment=experiment)
    with pytest.raises(TrextonError, match="no experiment on flights"):
        verify(path, tmp_path, "flight")


def test_differences_compare_kinds_too():
    assert differences({"a": [1, 2]}, {"a": [1, 2, 3]}) == ["a.2: absent -> 3"]
    assert differences({"a": {}, "b": 1}, {"b": 1}) == ["a: {} -> absent"]
    assert differences({"a": {"b": 1}}, {"a": {"b": 1.0}}) == ["a.b: 1 -> 1.0"]
    assert differences([True, None, 0.0], [True, None, 1e-13]) == []


def test_a_real_record_is_rebuilt(tmp_path):
    folder = write_flight(small_flight(), tmp_path / "small")
    parameters = mocap_training.Parameters(particles=20, neighbors=2, repeats=2)
    flight = small_flight()
    record = mocap_training.run(flight.part("train"), flight.part("test"), parameters)
    path = record.save(tmp_path / "results")
    content = json.loads(path.read_text())
    content["values"]["counts"]["train"] += 1
    path.write_text(json.dumps(content))
    verdict = verify(path, tmp_path / "work", str(folder))
    changed = [line for line in verdict.changes if not line.startswith("data of flight")]
    assert changed == ["values.counts.train: 21 -> 20"]


def test_the_committed_reference_says_how_it_was_made():
    for path in references():
        content = json.loads(path.read_text())
        assert content["values"] and set(content["provenance"]["simulated"]) == {"train", "test"}
        assert set(content["provenance"]["flights"]) == {"train", "test"}
