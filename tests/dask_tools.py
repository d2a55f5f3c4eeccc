"""A Dask scheduler and workers in processes of their own, on loopback."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from conftest import ROOT, python_path
from patience import eventually

from trexton.companion.build.workers import connect

__all__ = ["Cluster"]


class Cluster:
    """Started with so many workers of one thread each; ends them all on leaving."""

    def __init__(self, folder: Path, workers: int = 2, options: Sequence[str] = ()):
        self.folder, self.size, self.options = folder, workers, options
        self.processes: list[subprocess.Popen] = []
        tests = Path(__file__).parent  # and the folder of the tests whose functions are called
        paths = python_path(ROOT, tests, tests / "companion" / "build")
        self.environment = os.environ | {"PYTHONPATH": paths}

    def __enter__(self) -> Cluster:
        self.host = "tls://127.0.0.1" if self.options else "127.0.0.1"  # options of TLS
        file = self.folder / "scheduler.json"
        self._start("scheduler", "--host", self.host, "--port", "0", "--scheduler-file", file)
        for _ in range(self.size):
            self._start_worker()
        self._address(file)
        if self.size:
            self._wait(self.size)
        return self

    def add_worker(self) -> None:
        """One more, which is there when this returns."""
        self._start_worker()
        self._wait(1)

    def _start_worker(self) -> None:
        file = self.folder / "scheduler.json"
        options = ["--nthreads", "1", "--no-nanny", "--local-directory", self.folder]
        self._start("worker", "--scheduler-file", file, "--host", self.host, *options)

    def _wait(self, workers: int) -> None:
        with connect(self.address) as client:
            client.wait_for_workers(workers, timeout=120)

    @property
    def alive(self) -> int:
        """Processes that run."""
        return [process.poll() for process in self.processes].count(None)

    def _start(self, kind: str, *words: object) -> None:
        command = [
            sys.executable,
            "-m",
            f"distributed.cli.dask_{kind}",
            "--no-dashboard",
            *self.options,
        ]
        with open(self.folder / f"{kind}-{len(self.processes)}.log", "w") as log:
            self.processes.append(
                subprocess.Popen(
                    [*command, *map(str, words)], env=self.environment, stdout=log, stderr=log
                )
            )

    def _address(self, file: Path) -> str:
        def told() -> str:
            try:
                return json.loads(file.read_text())["address"]
            except (OSError, ValueError, KeyError):
                return ""

        self.address = eventually(told)
        assert self.address, (self.folder / "scheduler-0.log").read_text()[-2000:]
        return self.address

    def __exit__(self, *_: object) -> None:
        for process in reversed(self.processes):
            process.kill()
        for process in self.processes:
            process.wait()
