"""Verification: what changed is found and named, what did not is left in peace."""

import json
import subprocess
from pathlib import Path
from types import SimpleNamespace

import pytest
from conftest import small_flight

from trexton.base.errors import TrextonError
from trexton.base.records import SCHEMA
from trexton.cli.main import main
from trexton.companion.checks import verify as module
from trexton.companion.checks.verify import VARIANTS, differences, references, update, verify
from trexton.companion.experiments import mocap_training
from trexton.flights import write_flight

VALUES = {"error_cm": 12.5, "frames": 40, "ranks": [1.0, 2.0]}


def saved(path, **changes):
    """A record's file with a recipe of flights that nobody will fly."""
    content = {
        "schema": 1,
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
def processes(monkeypatch):
    """Processes that leave the record they are told to, one after the other, the last for good."""
    told = SimpleNamespace(records=[{}], status=0, environments=[], commands=[])

    def run(command, env, **_):
        told.environments.append(env)
        told.commands.append(command)
        from pathlib import Path

        out = Path(command[4])
        out.mkdir()
        which = min(len(told.commands), len(told.records)) - 1
        saved(out / "mocap_training.json", **told.records[which])
        return SimpleNamespace(returncode=told.status, stderr="Traceback\nKeyError: 'lost'\n")

    monkeypatch.setattr(subprocess, "run", run)
    return told


def test_what_is_as_it_was_holds(processes, tmp_path):
    verdict = verify(saved(tmp_path / "r.json"), tmp_path, "flight")
    assert verdict.changes == verdict.disagreements == []
    assert {env["PYTHONHASHSEED"] for env in processes.environments} == {"0", "1"}
    assert {env["OMP_NUM_THREADS"] for env in processes.environments} == {"1", "2"}
    assert processes.environments[-1]["OPENBLAS_CORETYPE"] == "Nehalem"
    caches = [env["TREXTON_CACHE"] for env in processes.environments]
    assert caches[2] == caches[0] and len(set(caches)) == len(VARIANTS) - 1


def test_a_record_of_the_first_schema_is_compared_as_it_would_be_written_today(processes, tmp_path):
    old, new = (
        {"error_cm": {name: 12.5, "low": 9.0, "high": 16.0}} for name in ("median", "value")
    )
    processes.records = [{"schema": SCHEMA, "values": new}]
    assert verify(saved(tmp_path / "r.json", values=old), tmp_path, "flight").changes == []


def test_a_changed_number_is_found_and_named_with_the_version_that_moved(processes, tmp_path):
    path = saved(tmp_path / "r.json")
    processes.records = [{"values": VALUES | {"error_cm": 12.5 * (1 + 2e-9), "frames": 41}}]
    verdict = verify(path, tmp_path, "flight")
    assert not verdict.disagreements
    assert [line.split(":")[0] for line in verdict.changes] == ["values.error_cm", "values.frames"]
    assert "values.frames: 40 -> 41" in verdict.changes
    assert any(line.startswith("numpy: '1.0' -> ") for line in verdict.versions)


def test_other_data_are_named(processes, tmp_path):
    processes.records = [{"provenance": {"flights": {"train": "cd"}}}]
    verdict = verify(saved(tmp_path / "r.json"), tmp_path, "flight")
    assert verdict.changes == ["data of flight.train: 'ab' -> 'cd'"]


def test_flights_simulated_anew_are_judged_by_their_values(processes, tmp_path, monkeypatch):
    """Their last bits are the processor's; two records of one recipe share a flight."""
    made = []

    def record_flight(folder, **recipe):
        made.append(recipe)
        folder.mkdir(parents=True)

    monkeypatch.setattr("trexton.simulator.record_flight", record_flight)
    recipe = {"train": {"frames": 3, "seed": 1}, "test": {"frames": 3, "seed": 2}}
    processes.records = [{"provenance": {"flights": {"train": "cd"}}}]
    for name in ("one", "two"):
        path = saved(tmp_path / f"{name}.json")
        content = json.loads(path.read_text())
        content["provenance"]["simulated"] = recipe
        path.write_text(json.dumps(content))
        assert verify(path, tmp_path).changes == []
    assert made == [recipe["train"], recipe["test"]]
    folders = processes.commands[0][-2:]
    assert [Path(folder).name for folder in folders] == ["train", "test"]
    assert processes.commands[-1][-2:] == folders


def test_a_process_that_is_off_by_a_bit_is_named(processes, tmp_path):
    off = {"values": VALUES | {"error_cm": 12.500000000000002}}
    processes.records = [{}, {}, off, {}, {}]
    verdict = verify(saved(tmp_path / "r.json"), tmp_path, "flight")
    assert verdict.changes == []  # as near to the record as another version may be
    (line,) = verdict.disagreements
    assert line.startswith("warm cache: ") and "12.500000000000002" in line
    with pytest.raises(TrextonError, match="disagree"):
        update(verdict)


def test_other_kernels_may_round_otherwise_but_no_more(processes, tmp_path):
    off = [{"values": VALUES | {"error_cm": 12.5 * factor}} for factor in (1 + 1e-12, 1 + 1e-8)]
    processes.records = [{}, {}, {}, *off]
    verdict = verify(saved(tmp_path / "r.json"), tmp_path, "flight")
    (line,) = verdict.disagreements
    assert line.startswith("BLAS kernels of Nehalem: values.error_cm")


def test_the_command_shows_the_difference_and_updates_when_told(processes, tmp_path, capsys):
    path = saved(tmp_path / "r.json")
    before = path.read_bytes()
    many = {"values": VALUES | {str(n): n for n in range(30)}, "series": {"track": [1.0]}}
    processes.records = [many]
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


def test_the_command_names_a_process_that_disagrees(processes, tmp_path, capsys):
    processes.records = [{}, {"values": VALUES | {"frames": 41}}, {}]
    assert main(["verify", str(saved(tmp_path / "r.json")), "--flight", "flight"]) == 1
    assert "another hash seed, two threads: " in capsys.readouterr().out


def test_results_of_runs_are_not_updated(processes, tmp_path):
    provenance = {"flights": {"train": "ab"}}
    path = saved(tmp_path / "r.json", provenance=provenance)
    processes.records = [{"values": {}}]
    with pytest.raises(TrextonError, match="run its experiment again"):
        update(verify(path, tmp_path, "flight"))


def test_faults_are_one_clear_error(processes, tmp_path, monkeypatch):
    path = saved(tmp_path / "r.json", provenance={"flights": {"train": "ab"}})
    with pytest.raises(TrextonError, match="train: name their folders with --flight"):
        verify(path, tmp_path)
    processes.status = 1
    with pytest.raises(TrextonError, match="one thread, cold cache: KeyError: 'lost'"):
        verify(path, tmp_path, "flight")
    for text in ("{", "[]", '{"parameters": {}}', '{"parameters": 1, "provenance": {}}'):
        path.write_text(text)
        with pytest.raises(TrextonError, match="not a readable record"):
            verify(path, tmp_path, "flight")
    monkeypatch.setattr(module, "kept_results", lambda: [])
    with pytest.raises(TrextonError, match="name a record"):
        references()


@pytest.mark.parametrize("experiment", ["claims", "nobody"])
def test_only_experiments_on_flights_are_rebuilt(experiment, tmp_path):
    path = saved(tmp_path / "r.json", experiment=experiment)
    with pytest.raises(TrextonError, match="no experiment on flights"):
        module.rebuild(str(path), str(tmp_path), "flight")


def test_differences_compare_kinds_too():
    assert differences({"a": [1, 2]}, {"a": [1, 2, 3]}) == ["a.2: absent -> 3"]
    assert differences({"a": {}, "b": 1}, {"b": 1}) == ["a: {} -> absent"]
    assert differences({"a": {"b": 1}}, {"a": {"b": 1.0}}) == ["a.b: 1 -> 1.0"]
    assert differences([True, None, 0.0], [True, None, 1e-13]) == []
    assert differences(0.0, 1e-13, "x", within=0) == ["x: 0.0 -> 1e-13"]


def test_a_real_record_is_rebuilt_in_real_processes(tmp_path):
    folder = write_flight(small_flight(), tmp_path / "small")
    parameters = mocap_training.Parameters(particles=20, neighbors=2, repeats=2)
    flight = small_flight()
    record = mocap_training.run(flight.part("train"), flight.part("test"), parameters)
    path = record.save(tmp_path / "results")
    content = json.loads(path.read_text())
    content["values"]["counts"]["train"] += 1
    path.write_text(json.dumps(content))
    variants = {name: VARIANTS[name] for name in ("one thread, cold cache", "warm cache")}
    verdict = verify(path, tmp_path / "work", str(folder), variants=variants)
    assert verdict.disagreements == []
    changed = [line for line in verdict.changes if not line.startswith("data of flight")]
    assert changed == ["values.counts.train: 21 -> 20"]


def test_the_committed_reference_says_how_it_was_made():
    for path in references():
        content = json.loads(path.read_text())
        assert content["values"] and set(content["provenance"]["simulated"]) == {"train", "test"}
        assert set(content["provenance"]["flights"]) == {"train", "test"}
