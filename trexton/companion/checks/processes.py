"""What takes a process of its own: the time until something happens, and the loop on board.

Offers the stages `start` and `onboard`.
"""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Iterator

import numpy as np

from trexton.companion.checks.scene import Scene
from trexton.companion.checks.timing import Row, row
from trexton.localization.map_files import save_map

__all__ = ["onboard", "start"]

_PROGRAMS = {
    "bare": "import numpy, cv2",
    "trexton --help": "from trexton.cli.main import main; main(['--help'])",
    "first frame": """
import sys
import numpy as np
from trexton.localization.localizer import Localizer
from trexton.localization.map_files import load_map
localizer = Localizer(load_map(sys.argv[1]), rng=np.random.default_rng(1))
assert localizer.step(np.load(sys.argv[2])[0]).observed
""",
}
# Counts the whole process, its threads included, from the first frame after the caches are warm.
_LOOP = """
import sys, threading, time
import numpy as np
from trexton.onboard import Settings, build
from trexton.onboard.sources import Frame, Source
from trexton.onboard.status import resident_bytes

class Film(Source):
    live, gives, index = False, "images", 0

    def open(self):
        pass

    def read(self):
        self.index += 1
        if self.index in (50, 50 + frames):
            clocks.append((time.process_time(), time.perf_counter()))
        if self.index < 50 + frames:
            return Frame(0.08 * self.index, pictures[self.index % len(pictures)])

pictures, frames, clocks = list(np.load(sys.argv[2])), int(sys.argv[3]), []
loop = build(Settings(sys.argv[1], ("csv:/dev/null",)))  # its camera is never opened
loop.source = Film()
loop.run(threading.Event())
cpu, wall = np.diff(clocks, axis=0)[0] / frames
print(cpu, wall, resident_bytes() - sum(each.nbytes for each in pictures))
"""


def start(scene: Scene) -> Iterator[Row]:
    """The command's help, and a process from nothing to its first estimate, with the caches of
    kernels and bytecode warm.
    """
    seconds: dict[str, list[float]] = {name: [] for name in _PROGRAMS}
    for turn in range(4 if scene.quick else 11):
        for name, program in _PROGRAMS.items():
            began = time.perf_counter()
            _python(scene, program)
            if turn:  # the first warms the caches
                seconds[name].append(time.perf_counter() - began)
    bare = "import NumPy and OpenCV", seconds["bare"]
    for name, limit in (("trexton --help", 1.0), ("first frame", 1.2)):
        yield row(f"start, {name}", "process", 1, seconds[name], *bare, limit)


def onboard(scene: Scene) -> Iterator[Row]:
    """CPU time of a frame, all threads of the process together, beside the time that passed; and
    the memory it holds. Pictures come from memory: no camera is read, no JPEG decoded."""
    frames = 500 if scene.quick else 5000
    cpu, wall, resident = map(float, _python(scene, _LOOP, frames).split()[-3:])
    note = f"{1e3 * cpu:.2f} ms CPU, {resident / 2**20:.0f} MiB resident"
    yield row("onboard loop, CPU", f"{frames} frames", 1, cpu, "time passed", wall, None, note)


def _python(scene: Scene, program: str, *words: object) -> str:
    """What a program prints that is given a map, pictures and some words."""
    texton_map, pictures = scene.folder / "map.npz", scene.folder / "pictures.npy"
    if not pictures.exists():
        save_map(scene.map(), texton_map)
        np.save(pictures, np.stack(scene.views[:12]))
    # An environment without bytecode would have every source compiled anew: its own cache.
    environment = {
        name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"
    } | {"PYTHONPYCACHEPREFIX": str(scene.folder / "bytecode")}
    command = [sys.executable, "-c", program, str(texton_map), str(pictures), *map(str, words)]
    done = subprocess.run(command, check=True, capture_output=True, text=True, env=environment)
    return done.stdout
