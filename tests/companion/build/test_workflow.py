"""The workflow: parameters checked, results reused while true, failures named, nothing halved."""

from __future__ import annotations

import fcntl
import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace

import nbformat
import pytest
from conftest import ROOT, small_flight
from patience import alive, eventually
from pytask_parallel import execute as scheduler
from tiny_experiment import tiny
from tiny_notebooks import BODY, FAILING, run_here, write_notebook

from trexton.base.errors import FlightError, ParameterError, TrextonError
from trexton.cli import main as cli
from trexton.companion.build.flight_pairs import FlightPair, load_pair
from trexton.companion.build.plan import run_experiments
from trexton.companion.experiments.declaration import Experiment
from trexton.flights.folder import read_flight
from trexton.flights.writing import write_flight


@pytest.fixture
def house(tmp_path, flight_folder):
    """A flight, two tiny notebooks of which the second reads the first, and a way to run them."""

    class House:
        notebooks, out, flight = tmp_path / "notebooks", tmp_path / "out", flight_folder
        experiments = {"first": tiny("First"), "second": tiny("Second", after=("first",))}

        def run(self, **options):
            own = {"jobs": 1, "notebooks": self.notebooks, "experiments": self.experiments}
            outcomes = run_experiments([FlightPair(str(self.flight))], self.out, **own | options)
            return {outcome.experiment: outcome for outcome in outcomes}

        def runs(self, name):
            file = self.notebooks / f"{name}.runs"
            return len(file.read_text()) if file.exists() else 0

        def record(self, name):
            return json.loads((self.out / "small" / f"{name}.json").read_text())

        def left(self):
            return sorted(path.name for path in (self.out / "small").iterdir())

    write_notebook(House.notebooks, "first")
    write_notebook(House.notebooks, "second")
    return House()


@pytest.fixture
def without_kernels(monkeypatch):
    """Seconds faster where a test is about what runs, not how."""
    monkeypatch.setattr("trexton.companion.build.execution.execute", run_here)


LEDGER = """import json
from pathlib import Path
found = sorted(str(p.relative_to(out)) for p in Path(out).glob('*/*.json'))
(Path(out) / 'ledger.json').write_text(json.dumps({'values': found, 'timings': {}}))
"""


def in_words(outcome):
    """Its reasons, a sign for each hash."""
    return ", ".join(re.sub(r"\b[0-9a-f]{12}\b", "#", each) for each in outcome.reasons)


def statuses(outcomes):
    return {name: outcome.status for name, outcome in outcomes.items()}


def test_results_are_reused_until_something_that_went_in_changes(without_kernels, house):
    assert statuses(house.run()) == {"first": "ran", "second": "ran"}
    assert statuses(house.run()) == {"first": "reused", "second": "reused"}
    assert (house.runs("first"), house.runs("second")) == (1, 1)

    changed = house.run(settings={"first.factor": "3"})
    assert changed["first"].reasons == ("parameter factor 2 -> 3",)
    assert in_words(changed["second"]) == "record small/first # -> #"
    assert house.record("first")["values"]["frames"] == 3 * 40

    back = house.run(only=["first"])
    assert back["first"].reasons == ("parameter factor 3 -> 2",)
    notebook = house.notebooks / "first.md"
    notebook.write_text(notebook.read_text().replace("A tiny", "A very tiny"))
    assert in_words(house.run(only=["first"])["first"]) == "the notebook's text # -> #"

    frames = house.flight / "frames.csv"
    frames.write_text(frames.read_text().replace("1,0.0,1.0,0.0", "1,0.0,1.0,0.001"))
    assert in_words(house.run(only=["first"])["first"]) == "data of the flight train # -> #"

    (house.out / "small" / "first-chart.svg").write_text("<svg>touched</svg>")
    (house.out / "small" / "first.json").unlink()
    said = in_words(house.run(only=["first"])["first"])
    assert said == "first-chart.svg # -> #, first.json # -> absent"


def test_a_rename_of_the_flights_folder_changes_nothing(without_kernels, house, tmp_path):
    house.run()
    house.flight = house.flight.rename(tmp_path / "elsewhere")
    assert statuses(house.run()) == {"first": "reused", "second": "reused"}


@pytest.fixture(scope="module")
def executed(tmp_path_factory):
    """Two notebooks run in kernels, the second in vain, into a folder of an odd name: that folder,
    the given flight, the first as it was executed, and why the second failed.
    """
    folder = tmp_path_factory.mktemp("executed")
    flight, out = write_flight(small_flight(), folder / "small"), folder / 'Jürgens "out" \\n'
    write_notebook(folder / "notebooks", "first", "print(out)\n" + BODY)
    write_notebook(folder / "notebooks", "second", "raise ValueError(out)\n")
    first, failed = run_experiments(
        [FlightPair(str(flight))], out, jobs=2, notebooks=folder / "notebooks",
        experiments={"first": tiny("First"), "second": tiny("Second", after=("first",))},
        settings={"factor": 5},
    )  # fmt: skip
    assert (first.status, failed.status) == ("ran", "failed"), (first, failed)
    notebook = nbformat.read(out / "small" / "first.ipynb", as_version=4)
    return out, flight, notebook, failed.reasons


def test_the_executed_notebook_holds_its_parameters_and_nothing_of_the_clock(executed):
    out, flight, notebook, _ = executed
    given = {"flight": str(flight), "test_flight": None, "out": str(out)}
    assert notebook["metadata"]["trexton"] == {
        "parameters": {"factor": 5, "label": "a", "rate": 0.5, **given}
    }
    (injected,) = [
        cell
        for cell in notebook["cells"]
        if "injected-parameters" in cell["metadata"].get("tags", [])
    ]
    assert "factor = 5" in injected["source"] and "remove-cell" in injected["metadata"]["tags"]
    own = [notebook["metadata"], *(cell["metadata"] for cell in notebook["cells"])]
    assert "papermill" not in json.dumps(own)  # it tells times
    assert "iopub" not in json.dumps(notebook)


def test_the_folder_that_was_worked_in_is_named_nowhere_whatever_its_name(executed):
    out, _, notebook, reasons = executed
    assert ".work." not in json.dumps(notebook) + str(reasons)
    assert notebook["cells"][-1]["outputs"][0]["text"] == f"{out}\n"
    assert f"ValueError: {out};" in reasons[0]
    names = {}
    exec(notebook["cells"][2]["source"], names)
    assert names["out"] == str(out)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        (
            {"colour": "1"},
            "no experiment chosen here has a parameter 'colour': there are factor, label, rate",
        ),
        ({"first.colour": "1"}, "first has no parameter 'colour': it has factor, rate, label"),
        ({"third.factor": "1"}, "no experiment chosen here has a parameter 'third.factor'"),
        ({"factor": "many"}, "parameter factor is 'many': expected int"),
        ({"factor": "2.5"}, "parameter factor is 2.5: expected int"),
        ({"factor": "true"}, "parameter factor is True: expected int"),
        ({"factor": "none"}, "parameter factor is None: expected int"),
        ({"rate": "fast"}, "parameter rate is 'fast': expected float or None"),
        ({"flight": "x"}, "'flight' is given by the workflow"),
    ],
)
def test_unknown_parameters_and_wrong_types_are_errors(house, settings, message):
    with pytest.raises(ParameterError) as caught:
        house.run(settings=settings)
    assert message in str(caught.value)
    assert not house.out.exists()


def test_no_notebook_at_once_is_refused(house):
    with pytest.raises(ParameterError, match="jobs is 0: expected a whole number of at least 1"):
        house.run(jobs=0)
    assert not house.out.exists()


@pytest.mark.parametrize("name", ["n" * 300, "../up", ""])
def test_a_name_that_no_folder_can_have_is_one_short_sentence(house, tmp_path, name):
    house.flight = write_flight(replace(small_flight(), name=name), tmp_path / "named")
    with pytest.raises(FlightError, match="cannot name a folder of results: use at most 80") as one:
        house.run()
    assert len(str(one.value)) < len(str(house.flight)) + 150 and not house.out.exists()


def test_a_failing_notebook_names_its_cell_and_the_others_go_on(house):
    house.experiments = {
        "broken": tiny("Broken"),
        "heir": tiny("Heir", after=("broken",)),
        "dead": tiny("Dead"),
        "first": tiny("First"),
    }
    write_notebook(house.notebooks, "broken", "print('so far')\n" + FAILING)
    write_notebook(house.notebooks, "heir")
    write_notebook(house.notebooks, "dead", "import os\nos._exit(3)")
    outcomes = house.run(jobs=2)
    assert statuses(outcomes) == {
        "broken": "failed",
        "heir": "skipped",
        "dead": "failed",
        "first": "ran",
    }
    (reason,) = outcomes["broken"].reasons
    assert "broken.md, cell 3" in reason and "ZeroDivisionError: division by zero" in reason
    partial = house.out / "small" / "broken.failed.ipynb"
    assert "so far" in partial.read_text() and str(partial) in reason
    assert outcomes["heir"].reasons == ("broken, which it builds on, failed",)
    assert "dead.md: DeadKernelError" in outcomes["dead"].reasons[0]


def test_the_last_good_result_stays_until_its_successor_is_whole(without_kernels, house):
    house.run()
    good = {path.name: path.read_bytes() for path in (house.out / "small").iterdir()}
    write_notebook(house.notebooks, "first", FAILING)
    assert statuses(house.run()) == {"first": "failed", "second": "skipped"}
    kept = {path.name: path.read_bytes() for path in (house.out / "small").iterdir()}
    assert kept == good | {"first.failed.ipynb": b"partial"}
    write_notebook(house.notebooks, "first")
    assert statuses(house.run()) == {"first": "reused", "second": "reused"}
    house.run(settings={"first.factor": 5})
    assert not (house.out / "small" / "first.failed.ipynb").exists()


def test_what_a_new_run_no_longer_makes_is_gone(without_kernels, house):
    house.run(only=["first"])
    without = BODY.replace('(folder / "NAME-chart.svg").write_text("<svg/>")', "")
    write_notebook(house.notebooks, "first", without)
    assert house.run(only=["first"])["first"].status == "ran"
    assert house.left() == ["first.ipynb", "first.json"]


def test_stale_results_are_not_shown_to_whoever_looks_at_all(without_kernels, house):
    write_notebook(house.notebooks, "ledger", LEDGER, 'out = "results"')
    house.experiments = {"ledger": Experiment("Ledger")} | house.experiments
    house.run()
    write_notebook(house.notebooks, "first", FAILING)
    assert statuses(house.run()) == {"first": "failed", "second": "skipped", "ledger": "ran"}
    assert (house.out / "small" / "first.json").exists()
    assert json.loads((house.out / "ledger.json").read_text())["values"] == []


def test_what_a_flight_cannot_serve_is_skipped_with_the_reason(house, image_folder):
    house.experiments = {
        "first": tiny("First", needs=("images",)),
        "second": tiny("Second", needs=("floor",)),
    }
    outcomes = house.run()
    assert {name: outcome.reasons for name, outcome in outcomes.items()} == {
        "first": ("small has no images",), "second": ("small has no picture of its true floor",),
    }  # fmt: skip
    frames = house.flight / "frames.csv"
    frames.write_text(frames.read_text().replace("1,0.0,1.0,0.0", "1,0.0,nan,nan"))
    house.experiments = {"first": tiny("First", needs=("positions",))}
    assert house.run()["first"].reasons == ("small lacks positions in some frames",)


def test_a_flight_without_splits_tests_on_its_later_frames(house, tmp_path, capsys):
    whole = write_flight(replace(small_flight(), split={}), tmp_path / "whole")
    pair = FlightPair(str(whole))
    count = len(read_flight(whole))
    (first, last), (begin, end) = pair.train.split["train"], pair.train.split["test"]
    assert (first, begin, end) == (1, last + 1, count) and 0 < last < end
    assert "has no splits train and test: frames 1 to" in capsys.readouterr().err
    train, test = load_pair(whole, None)
    assert (len(train), len(test)) == (last, end - last)
    pair = FlightPair(str(whole), str(house.flight))
    assert pair.hashes == {
        "train": read_flight(whole).data_hash,
        "test": read_flight(house.flight).data_hash,
    }


def test_the_ledger_runs_once_over_the_records_of_every_flight(without_kernels, house):
    write_notebook(house.notebooks, "ledger", LEDGER, 'out = "results"')
    house.experiments = {"ledger": Experiment("Ledger")} | house.experiments
    assert house.run()["ledger"].status == "ran"
    assert json.loads((house.out / "ledger.json").read_text())["values"] == [
        "small/first.json",
        "small/second.json",
    ]
    assert house.run()["ledger"].status == "reused"
    ledger = house.run(settings={"second.factor": 9})["ledger"]
    assert in_words(ledger) == "record small/second # -> #"


def test_two_notebooks_run_at_once_and_a_timed_one_alone(house):
    body = (
        "import time, os\nstart = time.time()\ntime.sleep(1.0)\n"
        "print(os.environ.get('OMP_NUM_THREADS'))\n" + BODY
    )
    body = body.replace('"timings": {}', '"timings": {"start": start, "end": time.time()}')
    timed = {"timed": tiny("T", alone=True, cost_s=999)}
    house.experiments = {"a": tiny("A"), "b": tiny("B")} | timed
    for name in house.experiments:
        write_notebook(house.notebooks, name, body)
    assert set(statuses(house.run(jobs=2)).values()) == {"ran"}
    spans = {name: house.record(name)["timings"] for name in house.experiments}

    def overlap(one, two):
        return spans[one]["start"] < spans[two]["end"] and spans[two]["start"] < spans[one]["end"]

    assert overlap("a", "b") and not overlap("a", "timed") and not overlap("b", "timed")
    assert f'"{max(1, (os.cpu_count() or 1) // 2)}' in (house.out / "small" / "a.ipynb").read_text()


def test_what_takes_long_or_is_waited_for_starts_first(without_kernels, house):
    """Left to the engine the order is arbitrary, and a long one may be alone at the end."""
    quick = {name: tiny(name) for name in "abcdef"}
    house.experiments = quick | {
        "long": tiny("L", cost_s=90),
        "read": tiny("R"),
        "heir": tiny("H", after=("read",)),
        "timed": tiny("T", alone=True, cost_s=999),
    }
    order = house.notebooks / "order"
    for name in house.experiments:
        line = f"with open({str(order)!r}, 'a') as stream:\n    stream.write('{name} ')\n"
        write_notebook(house.notebooks, name, line + BODY)
    assert set(statuses(house.run()).values()) == {"ran"}
    began = order.read_text().split()
    assert {*began[:2]} == {"long", "read"} and began[-1] == "timed"
    assert scheduler._Sleeper().timings == [0.05]  # what has ended is soon seen


def test_a_memory_that_cannot_be_read_is_put_away(without_kernels, house):
    house.run()
    lock = house.out / ".engine" / "pytask.lock"
    lock.write_bytes(bytes(100))  # as a loss of power leaves it
    assert house.run(settings={"factor": 3})["first"].reasons == ("no finished run",)
    assert lock.with_suffix(".damaged").is_file()


def test_killed_in_the_middle_it_leaves_no_kernel_and_is_run_again(
    without_kernels, house, tmp_path, monkeypatch
):
    """Killed outright while a notebook runs; the next run starts over, nothing is half-made."""
    marker = tmp_path / "kernel.pid"
    body = (
        BODY
        + f"import os, time\nPath({str(marker)!r}).write_text(str(os.getpid()))\ntime.sleep(60)\n"
    )
    write_notebook(house.notebooks, "first", body)
    script = (
        f"import sys; sys.path.insert(0, {str(ROOT / 'tests')!r})\n"
        "from tiny_experiment import tiny\n"
        "from trexton.companion.build.flight_pairs import FlightPair\n"
        "from trexton.companion.build.plan import run_experiments\n"
        "run_experiments([FlightPair(sys.argv[1])], sys.argv[2], notebooks=sys.argv[3],\n"
        "                experiments={'first': tiny('F')})"
    )
    places = (str(house.flight), str(house.out), str(house.notebooks))
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setenv("TMPDIR", str(temporary))
    run = subprocess.Popen([sys.executable, "-c", script, *places], stderr=subprocess.DEVNULL)
    kernel = eventually(lambda: marker.exists() and marker.read_text())
    run.send_signal(signal.SIGKILL)
    run.wait()
    assert eventually(lambda: not alive(int(kernel)))
    assert not (house.out / "small" / "first.json").exists() and not any(temporary.iterdir())

    write_notebook(house.notebooks, "first")
    house.experiments = {"first": tiny("First")}
    assert house.run()["first"].reasons == ("no finished run",)
    assert not list((house.out / ".engine").glob(".work.*"))
    assert house.left() == ["first-chart.svg", "first.ipynb", "first.json"]


def test_two_runs_do_not_write_to_one_folder(without_kernels, house):
    (house.out / ".engine").mkdir(parents=True)
    with open(house.out / ".engine" / "writer", "w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        with pytest.raises(TrextonError, match="another run is writing to"):
            house.run()
    assert statuses(house.run()) == {"first": "ran", "second": "ran"}


def test_the_command_line_says_it_in_one_sentence(house, capsys):
    command = ["--quiet", "run", str(house.flight), "--out", str(house.out), "--no-book"]
    for words, message in [
        (["--only", "nothing"], "no experiment is named 'nothing': the names are"),
        (["--set", "samples"], "--set 'samples': expected key=value"),
        (["--set", "colour=red"], "has a parameter 'colour'"),
        (["--notebooks", str(house.out)], "holds no notebook of an experiment: expected files"),
    ]:
        assert cli.main([*command[1:], *words, "--quiet"]) == 1
        error = capsys.readouterr().err
        assert message in error and error.count("\n") == 1
