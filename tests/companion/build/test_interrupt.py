"""A run that is interrupted ends at once, and what was finished is reused."""

from __future__ import annotations

import os
import signal
import subprocess
import sys

from conftest import ROOT, python_path
from patience import eventually
from tiny_experiment import tiny
from tiny_notebooks import BODY, run_here, write_notebook

from trexton.companion.build.flight_pairs import FlightPair
from trexton.companion.build.plan import run_experiments


def test_finished_tasks_survive_an_interrupt(flight_folder, tmp_path, monkeypatch):
    notebooks, mark = tmp_path / "notebooks", tmp_path / "started"
    write_notebook(notebooks, "first")
    slow = f"import time\nfrom pathlib import Path\nPath({str(mark)!r}).touch()\ntime.sleep(60)\n"
    write_notebook(notebooks, "second", slow + BODY)
    # A suite that a shell runs in the background has the interrupt ignored.
    script = f"""if True:
        import signal; signal.signal(signal.SIGINT, signal.default_int_handler)
        import sys; sys.path.insert(0, {str(ROOT / "tests")!r})
        from tiny_experiment import tiny
        from trexton.companion.build.flight_pairs import FlightPair
        from trexton.companion.build.plan import run_experiments
        experiments = {{"first": tiny("F"),
            "second": tiny("S", after=("first",))}}
        run_experiments([FlightPair({str(flight_folder)!r})], {str(tmp_path / "out")!r},
            notebooks={str(notebooks)!r}, experiments=experiments)"""
    environment = os.environ | {"PYTHONPATH": python_path(ROOT)}
    run = subprocess.Popen(
        [sys.executable, "-c", script], env=environment, stderr=subprocess.PIPE, text=True
    )
    assert eventually(lambda: mark.exists() or run.poll() is not None)
    assert run.poll() is None, run.stderr.read()
    run.send_signal(signal.SIGINT)
    said = run.communicate(timeout=120)[1]
    assert "KeyboardInterrupt" in said and "failed" not in said

    write_notebook(notebooks, "second")
    monkeypatch.setattr("trexton.companion.build.execution.execute", run_here)
    experiments = {
        "first": tiny("F"),
        "second": tiny("S", after=("first",)),
    }
    outcomes = run_experiments(
        [FlightPair(str(flight_folder))],
        tmp_path / "out",
        notebooks=notebooks,
        experiments=experiments,
        jobs=1,
    )
    assert [outcome.status for outcome in outcomes] == ["reused", "ran"]
