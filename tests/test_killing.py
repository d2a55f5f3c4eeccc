"""Killed outright at any step, a command leaves every file whole or absent; see `killing`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import killing
import pytest


def killed(*words: str) -> None:
    script = Path(killing.__file__)
    done = subprocess.run([sys.executable, script, *words], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    assert ": killed" in done.stdout and "0 faults" in done.stdout


def test_killed_at_every_step_it_loses_nothing_and_the_next_run_finishes():
    killed("--steps", "fetch")


def test_killed_a_few_times_at_random_moments_training_loses_nothing():
    killed("--kills", "3", "train")


@pytest.mark.slow
@pytest.mark.parametrize("name", killing.QUICK)
def test_so_does_every_quick_command(name):
    killed("--steps", name)


@pytest.mark.slow
@pytest.mark.parametrize("name", list(killing.CASES))
def test_killed_at_random_moments_it_loses_nothing_and_the_next_run_finishes(name):
    killed("--kills", "100", name)


def test_a_command_that_writes_in_place_is_found_out(tmp_path):
    code = (
        "import sys; from pathlib import Path; import killing\n"
        "from trexton.cli import export\n"
        "export.atomic_file = lambda path, mode='w': open(path, mode)\n"
        "print(killing.kill('export', Path(sys.argv[1]), 20, steps=True))"
    )
    command = [sys.executable, "-c", code, str(tmp_path)]
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=Path(killing.__file__).parent
    )
    assert "neither the old nor the new" in done.stdout, done.stdout + done.stderr
