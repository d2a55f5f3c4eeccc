"""What takes minutes, beside decoding the 800 images of a flight once, on one core (D).

``python tests/minutes.py suite book cluster`` on an idle computer prints a row for each as it is
measured: the suite and the book from nothing, in a clone of what is committed, and a sweep on a
Dask cluster of two workers, of whom one is killed midway and replaced, beside one of one worker.
"""

from __future__ import annotations

import argparse
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from itertools import cycle, islice
from pathlib import Path

import cv2
from conftest import ROOT
from dask_tools import Cluster

from trexton.companion.build.flight_pairs import FlightPair
from trexton.companion.build.sweep import SweepPlan, sweep
from trexton.companion.executor import environment
from trexton.simulator.floor import LAYOUTS
from trexton.simulator.recording import record_flight

SUITE = (*"-m pytest -n 3 --dist loadfile --no-loadscope-reorder -m".split(), "not slow")
COMMANDS = {"suite": SUITE, "book": ("-m", "trexton", "book")}


def decoding(folder: Path) -> float:
    """Seconds of a processor for the images of a flight of the virtual room: D."""
    flight = record_flight(folder / "survey", frames=800)
    cv2.setNumThreads(1)
    began = time.process_time()
    for row in range(len(flight)):
        flight.image(row)
    return time.process_time() - began


def from_nothing(words: tuple[str, ...], folder: Path) -> tuple[float, float]:
    """Seconds on the clock and of processors of a command in a clone, its caches empty."""
    clone = folder / "clone"
    subprocess.run(["git", "clone", "--quiet", str(ROOT), str(clone)], check=True)
    own = {"PYTHONPATH": str(clone), "TREXTON_CACHE": str(folder / "cache")}
    own |= dict.fromkeys(("OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1")
    variables = os.environ | own
    variables.pop("PYTHONDONTWRITEBYTECODE", None)  # else each process compiles all sources
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    subprocess.run([sys.executable, *words], cwd=clone, env=variables, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return time.monotonic() - began, used


class Pinned(Cluster):
    """A cluster whose workers have a processor each, as on computers of their own."""

    def _start_worker(self) -> None:
        here = os.sched_getaffinity(0)
        free = sorted(here)[self.alive % len(here)]  # that of one that was killed, too
        os.sched_setaffinity(0, {free})
        try:
            super()._start_worker()  # which inherits it
        finally:
            os.sched_setaffinity(0, here)


def swept(folder: Path, floors: int, workers: int) -> float:
    """Seconds of a sweep of so many floors; of two workers one is killed where half is done."""
    folder.mkdir()
    names = islice(cycle(LAYOUTS), floors)
    layouts = [f"{name}:{4000 + number}" for number, name in enumerate(names)]
    settings = {"floors": layouts, "frames": [300], "test_frames": [100]}
    pair = FlightPair(str(folder.parent / "survey"), str(folder.parent / "test"))
    own = environment({"TREXTON_CACHE": str(folder / "cache")})  # the sweep before warms none
    with own, Pinned(folder, workers) as cluster:
        done = threading.Thread(target=_replace_one, args=(cluster, folder, floors), daemon=True)
        if workers > 1:
            done.start()
        began = time.monotonic()
        result = sweep(SweepPlan("suitability", settings, [pair]), folder, cluster=cluster.address)
        taken = time.monotonic() - began
    assert not result.failed, result.failed
    return taken


def _replace_one(cluster: Cluster, folder: Path, floors: int) -> None:
    def half() -> bool:
        return len(list((folder / "cells").rglob("*.json"))) >= floors // 2

    while not half():
        time.sleep(0.5)
    cluster.processes[-1].kill()
    cluster.processes[-1].wait()
    cluster.add_worker()


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("what", nargs="+", choices=(*COMMANDS, "cluster"))
    parser.add_argument("--floors", type=int, default=10, help="of the sweep")
    chosen = parser.parse_args()
    for name in chosen.what:
        with tempfile.TemporaryDirectory() as made:
            folder = Path(made)
            unit = decoding(folder)
            if name in COMMANDS:
                clock, used = from_nothing(COMMANDS[name], folder)
                words = f"{clock:.0f} s on the clock ({clock / unit:.0f} D), "
                words += f"{used:.0f} s of processors ({used / unit:.0f} D)"
            else:
                record_flight(folder / "test", pattern="waypoints", frames=100)
                one, two = (swept(folder / str(each), chosen.floors, each) for each in (1, 2))
                words = f"{chosen.floors} floors, one worker {one:.0f} s, two {two:.0f} s, one of "
                words += f"them killed midway and replaced: {one / two:.2f} times as fast"
            print(f"{name}: {words}; D is {unit:.2f} s", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
