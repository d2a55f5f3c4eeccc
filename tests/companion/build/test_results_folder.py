"""Where results lie: never among a flight's files, and whole again whatever became of them."""

from __future__ import annotations

import resource
import subprocess

import pytest
from tiny_experiment import tiny
from tiny_notebooks import write_notebook

from trexton.base.errors import ParameterError, TrextonError
from trexton.companion.build import make
from trexton.companion.build.flight_pairs import FlightPair
from trexton.companion.build.plan import run_experiments
from trexton.companion.build.sweep import SweepPlan, sweep
from trexton.companion.build.workers import jobs_here, threads_of

KEPT = "mend it, what was there before is kept"


@pytest.mark.parametrize("out", ["small", ".", "other/../small", "link"])
def test_results_do_not_go_among_the_files_of_a_flight(flight_folder, monkeypatch, out):
    """``--out FLIGHT``, and ``--out .`` beside it: results are put into a folder of its name."""
    monkeypatch.chdir(flight_folder.parent)
    (flight_folder.parent / "link").symlink_to(flight_folder)
    (flight_folder.parent / "other").mkdir()
    before = sorted(flight_folder.parent.rglob("*"))
    for pair in (FlightPair("small"), FlightPair(str(flight_folder))):
        with pytest.raises(ParameterError, match="among the files of the flight .*small: name an"):
            run_experiments([pair], out)
        with pytest.raises(ParameterError, match="among the files of the flight"):
            sweep(SweepPlan("mocap_training", {}, [pair]), flight_folder.parent / out)
    assert sorted(flight_folder.parent.rglob("*")) == before


def test_what_stands_in_the_place_of_results_is_named_and_stays(flight_folder, tmp_path):
    notebooks, taken = tmp_path / "notebooks", tmp_path / "out" / "small"
    write_notebook(notebooks, "first")
    taken.parent.mkdir()
    taken.write_text("a person's")
    experiments = {"first": tiny("First")}
    (outcome,) = run_experiments(
        [FlightPair(str(flight_folder))], taken.parent, notebooks=notebooks, experiments=experiments
    )
    assert outcome.reasons == (f"small/first: {taken}: File exists: {KEPT}",)
    assert taken.read_text() == "a person's"


def test_without_a_home_or_open_files_a_run_is_refused_in_a_sentence(monkeypatch):
    """Notebooks died: "Kernel died before replying to kernel_info"."""
    with monkeypatch.context() as patch:
        patch.setattr(resource, "getrlimit", lambda kind: (32, 32))
        with pytest.raises(TrextonError, match="32 open files are allowed: say ulimit -n 1024"):
            jobs_here(None, 1)
    monkeypatch.setenv("HOME", "/proc")
    with pytest.raises(TrextonError, match="/proc: the home folder cannot be written to"):
        jobs_here(None, 1)


def test_a_disk_that_fills_under_the_book_is_named(monkeypatch, tmp_path):
    """``report.html`` is there by then; the book's builder tells no path."""
    said = "OSError: [Errno 28] No space left on device"
    done = subprocess.CompletedProcess([], 1, said, "")
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: done)
    with pytest.raises(OSError, match=f"No space left on device: '{tmp_path}'"):
        make._jupyter_book(tmp_path / "work" / "source", tmp_path / "work")


def test_a_single_notebook_has_every_core():
    assert jobs_here(None, 1) == 1 and threads_of(1) is None
    assert threads_of(2) is not None
