"""Processes that help: one result a item, and none of them outlives the one that started it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

from conftest import ROOT

from trexton.executor import CLUSTER, PROCESSES, limited, spread, working_on


def double(item: int) -> int:
    return 2 * item


def linger(folder: str) -> None:
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(120)


def test_results_come_in_order_and_the_choice_is_put_back():
    before = {name: os.environ.get(name) for name in (CLUSTER, PROCESSES)}
    with working_on(processes=3):
        assert spread(double, range(5)) == [0, 2, 4, 6, 8]
        assert spread(double, []) == []
    assert before == {name: os.environ.get(name) for name in (CLUSTER, PROCESSES)}


def test_threads_are_limited_for_what_is_started_and_put_back():
    before = os.environ.get("OMP_NUM_THREADS")
    with limited(3):
        assert os.environ["OMP_NUM_THREADS"] == "3"
        with limited(None):
            assert os.environ["OMP_NUM_THREADS"] == "3"
    assert os.environ.get("OMP_NUM_THREADS") == before


def test_no_process_outlives_a_killed_parent(tmp_path):
    script = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
        "from test_executor import *\n"
        "if __name__ == '__main__':\n"
        f"    with working_on(processes=2): spread(linger, [{str(tmp_path)!r}] * 2)\n"
    )
    file = tmp_path / "parent.py"
    file.write_text(script)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    parent = subprocess.Popen([sys.executable, file], env=environment, stderr=subprocess.DEVNULL)
    children = _wait(lambda: [int(p.name) for p in tmp_path.iterdir() if p.name.isdigit()][1:] and
                     [int(p.name) for p in tmp_path.iterdir() if p.name.isdigit()])  # fmt: skip
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    _wait(lambda: not any(_alive(child) for child in children))


def _wait(condition, seconds=90):
    end = time.monotonic() + seconds
    while not (found := condition()):
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.1)
    return found


def _alive(process: int) -> bool:
    try:
        return "Z" not in Path(f"/proc/{process}/stat").read_text().split(")")[1][:3]
    except (FileNotFoundError, ProcessLookupError):
        return False
