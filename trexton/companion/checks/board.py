"""How fast a computer flies: the onboard script itself, as a program of its own, over a flight of
the virtual room.

Offers `measure_board`, whose result is a line for the table of boards.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from importlib.metadata import version
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from trexton.base.streams import stream
from trexton.companion.provenance import machine
from trexton.localization.map_files import save_map
from trexton.localization.training import train_map

__all__ = ["measure_board"]

ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1")


def measure_board(frames: int = 600, method: str = "field", seed: int = 1) -> dict[str, Any]:
    """Median and 99th percentile of the latency in milliseconds, memory in MiB, and the seconds
    from the start of the program to its first position, with the kernels compiled before.

    Parameters
    ----------
    frames : int
        Of 640x480 pixels, from files: reading a camera comes on top.
    method : str
    seed : int
    """
    from trexton.simulator import record_flight

    with TemporaryDirectory() as folder:
        flight = record_flight(Path(folder) / "flight", frames=frames, seed=seed)
        made = train_map(flight, method=method, rng=stream(seed, "training"))
        words = ["onboard", str(save_map(made, Path(folder) / "map.npz")), "--camera"]
        words += [f"{folder}/flight", "--output", "json"]
        _flown([*words, "--frames", "2"])  # a first start compiles
        first_s, summary = _flown(words)
    latency = summary["latency_s"]
    return {
        "machine": machine(),
        "version": version("trexton"),
        "method": method,
        "frames": summary["frames"],
        "latency_ms": {"p50": 1e3 * latency["median"], "p99": 1e3 * latency["p99"]},
        "memory_mib": summary["memory_bytes"] / 2**20,
        "first_position_s": first_s,
    }


def _flown(words: list[str]) -> tuple[float, dict[str, Any]]:
    """Seconds to the first position of the script, and its summary."""
    began = time.monotonic()
    script = subprocess.Popen(
        [sys.executable, "-m", "trexton", *words],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=os.environ | ONE_THREAD,
    )  # fmt: skip
    assert script.stdout is not None
    script.stdout.readline()
    first_s = time.monotonic() - began
    _, said = script.communicate()
    if script.returncode:
        raise subprocess.CalledProcessError(script.returncode, words, stderr=said)
    summary: dict[str, Any] = json.loads(said.splitlines()[-1].partition(": ")[2])
    return first_s, summary
