"""How long it takes until something happens: processes started anew."""

from __future__ import annotations

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

__all__ = ["start"]

_FIRST_FRAME = """
import sys
import numpy as np
from trexton.localization.localizer import Localizer, TextonMap
localizer = Localizer(TextonMap.load(sys.argv[1]), rng=np.random.default_rng(1))
assert localizer.step(np.load(sys.argv[2])).observed
"""
_PROGRAMS = {
    "bare": "import numpy, cv2",
    "help": "from trexton.cli.main import main; main(['--help'])",
    "first frame": _FIRST_FRAME,
}


def start(scene: Scene, quick: bool) -> Iterator[Row]:
    """The command's help, and a process from nothing to its first estimate, with the caches of
    kernels and bytecode warm.
    """
    seconds: dict[str, list[float]] = {name: [] for name in _PROGRAMS}
    with tempfile.TemporaryDirectory() as folder:
        texton_map, frame = scene.map.save(Path(folder) / "map.npz"), Path(folder) / "frame.npy"
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
