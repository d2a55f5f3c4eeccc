"""Processes that help: one result a item, and none of them outlives the one that started it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from conftest import ROOT
from patience import alive, eventually

from trexton.companion.executor import PROCESSES, limited, spread, working_on


def double(item: int) -> int:
    return 2 * item


def linger(folder: str) -> None:
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(120)


def test_results_come_in_order_and_the_choice_is_put_back():
    before = os.environ.get(PROCESSES)
    with working_on(processes=3):
        assert spread(double, range(5)) == [0, 2, 4, 6, 8]
        assert spread(double, []) == []
    assert before == os.environ.get(PROCESSES)


def test_threads_are_limited_for_what_is_started_and_put_back():
    before = os.environ.get("OMP_NUM_THREADS")
    with limited(3):
        assert os.environ["OMP_NUM_THREADS"] == "3"
        with limited(None):
            assert os.environ["OMP_NUM_THREADS"] == "3"
    assert os.environ.get("OMP_NUM_THREADS") == before


def started(folder: Path) -> list[int]:
    return [int(path.name) for path in folder.iterdir() if path.name.isdigit()]


@pytest.mark.parametrize("slow_s", [0, 1.5])
def test_no_process_outlives_a_killed_parent(tmp_path, slow_s):
    """Not even where it is killed while its children still start, here for `slow_s` seconds."""
    script = (
        f"import sys; sys.path[:0] = {[str(ROOT / 'tests'), str(Path(__file__).parent)]!r}\n"
        "from test_executor import *\n"
        "if __name__ == '__main__':\n"
        f"    with working_on(processes=2): spread(linger, [{str(tmp_path)!r}] * 2)\n"
        f"elif {slow_s}:\n"
        f"    (Path({str(tmp_path)!r}) / str(os.getpid())).touch(); time.sleep({slow_s})\n"
    )
    file = tmp_path / "parent.py"
    file.write_text(script)
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    parent = subprocess.Popen([sys.executable, file], env=environment, stderr=subprocess.DEVNULL)
    children = eventually(lambda: len(found := started(tmp_path)) == 2 and found)
    assert children
    parent.send_signal(signal.SIGKILL)
    parent.wait()
    assert eventually(lambda: not any(alive(child) for child in children))
