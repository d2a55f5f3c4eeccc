"""What takes a process of its own: the time until something happens, and the loop on board.

Offers the stages `start` and `onboard`.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from trexton.companion.checks.scene import Scene
from trexton.companion.checks.timing import Row, Times
from trexton.localization.map_files import save_map

__all__ = ["onboard", "start"]

_FIRST_FRAME = """
import sys
import numpy as np
from trexton.localization.localizer import Localizer
from trexton.localization.map_files import load_map
localizer = Localizer(load_map(sys.argv[1]), rng=np.random.default_rng(1))
assert localizer.step(np.load(sys.argv[2])).observed
"""
_PROGRAMS = {
    "bare": "import numpy, cv2",
    "help": "from trexton.cli.main import main; main(['--help'])",
    "first frame": _FIRST_FRAME,
}

# Counts the whole process, its threads included, from the first frame after the caches are warm.
_LOOP = """
import json, sys, threading, time
import numpy as np
from trexton.onboard import Settings
from trexton.onboard import build
from trexton.onboard.sources import Frame, Source
from trexton.onboard.status import resident_bytes

class Film(Source):
    live, gives = False, "images"

    def __init__(self, pictures, frames, warm):
        self.pictures, self.frames, self.warm, self.index = pictures, frames, warm, 0
        self.cpu = self.wall = 0.0

    def open(self):
        pass

    def read(self):
        if self.index == self.warm:
            self.cpu, self.wall = time.process_time(), time.perf_counter()
        self.index += 1
        if self.index > self.frames + self.warm:
            self.cpu, self.wall = time.process_time() - self.cpu, time.perf_counter() - self.wall
            return None
        return Frame(0.08 * self.index, self.pictures[self.index % len(self.pictures)])

loop = build(Settings(sys.argv[1], ("csv:/dev/null",)))  # its camera is never opened
pictures = list(np.load(sys.argv[2]))
loop.source = film = Film(pictures, int(sys.argv[3]), 50)
loop.run(threading.Event())
seconds = [film.cpu / film.frames, film.wall / film.frames]
print(json.dumps({"seconds": seconds, "bytes": resident_bytes() - sum(p.nbytes for p in pictures)}))
"""


def start(scene: Scene, quick: bool) -> Iterator[Row]:
    """The command's help, and a process from nothing to its first estimate, with the caches of
    kernels and bytecode warm.
    """
    seconds: dict[str, list[float]] = {name: [] for name in _PROGRAMS}
    with tempfile.TemporaryDirectory() as folder:
        texton_map, frame = (
            save_map(scene.map, Path(folder) / "map.npz"),
            Path(folder) / "frame.npy",
        )
        np.save(frame, scene.frame)
        # An environment without bytecode would have every source compiled anew: its own cache.
        environment = {
            name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"
        } | {"PYTHONPYCACHEPREFIX": str(Path(folder) / "bytecode")}
        for turn in range(4 if quick else 11):
            for name, program in _PROGRAMS.items():
                began = time.perf_counter()
                command = [sys.executable, "-c", program, str(texton_map), str(frame)]
                subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)
                if turn:  # the first warms the caches
                    seconds[name].append(time.perf_counter() - began)
    times = {name: Times.of(taken) for name, taken in seconds.items()}
    bare = "import NumPy and OpenCV"
    for stage, name, limit in (
        ("trexton --help", "help", 1.0),
        ("first frame", "first frame", 1.2),
    ):
        yield Row.compare(f"start, {stage}", "process", 1, times[name], bare, times["bare"], limit)


def onboard(scene: Scene, quick: bool) -> Iterator[Row]:
    """CPU time of a frame, all threads of the process together, beside the time that passed; and
    the memory it holds. Pictures come from memory: no camera is read, no JPEG decoded."""
    frames = 500 if quick else 5000
    with tempfile.TemporaryDirectory() as folder:
        texton_map, pictures = (
            save_map(scene.map, Path(folder) / "map.npz"),
            Path(folder) / "film.npy",
        )
        np.save(pictures, np.stack(scene.views[0][:12]))
        command = [sys.executable, "-c", _LOOP, str(texton_map), str(pictures), str(frames)]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
    measured = json.loads(done.stdout.splitlines()[-1])
    cpu, wall = measured["seconds"]
    yield Row.compare(
        "onboard loop, CPU a frame", f"{frames} frames", 1, Times(cpu, cpu, 1), "time passed",
        wall, None, f"{1e3 * cpu:.2f} ms CPU, {measured['bytes'] / 2**20:.0f} MiB resident",
    )  # fmt: skip
