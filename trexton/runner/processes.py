"""Worker processes: each runs one notebook after another, with its own share of the threads."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable

__all__ = ["Crew"]

_THREAD_VARIABLES = (
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS", "OPENCV_FOR_THREADS_NUM",
)  # fmt: skip


class Crew:
    """Up to `size` worker processes, started when first needed and ended together.

    A worker that dies takes only its own notebook with it.
    """

    def __init__(self, size: int):
        self.size = size
        self._idle: list[_Worker] = []
        self._all: set[_Worker] = set()
        self._lock = threading.Lock()
        self._stopped = False

    def __enter__(self) -> Crew:
        return self

    def __exit__(self, *_) -> None:
        self.stop()

    def run(self, job: dict, threads: int | None, moved: Callable[[int, int], None]) -> dict:
        """Run one job in a worker with so many threads (None: all); blocks until its result is there."""
        worker = self._take(threads)
        result = worker.run(job, moved)
        with self._lock:
            if worker.alive and not self._stopped:
                self._idle.append(worker)
            else:
                self._all.discard(worker)
        return result

    def _take(self, threads: int | None) -> _Worker:
        with self._lock:
            worker = next((idle for idle in self._idle if idle.threads == threads), None)
            if worker:
                self._idle.remove(worker)
            else:
                worker = _Worker(threads)
                self._all.add(worker)
            return worker

    def stop(self) -> None:
        """End all workers, in the middle of a notebook if need be."""
        with self._lock:
            self._stopped = True
            workers, self._idle = list(self._all), []
        for worker in workers:
            worker.close()
        for worker in workers:
            worker.wait()


class _Worker:
    def __init__(self, threads: int | None):
        self.threads = threads
        environment = os.environ | {
            "JUPYTER_PREFER_ENV_PATH": "1",
            "PYDEVD_DISABLE_FILE_VALIDATION": "1",
        }
        if threads is not None:
            environment |= dict.fromkeys(_THREAD_VARIABLES, str(threads))
        command = [sys.executable, "-m", "trexton.runner.worker"]
        self._said = tempfile.TemporaryFile()
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._said,
            text=True,
            env=environment,
        )

    @property
    def alive(self) -> bool:
        return self._process.poll() is None

    def run(self, job: dict, moved: Callable[[int, int], None]) -> dict:
        try:
            self._process.stdin.write(json.dumps(job) + "\n")
            self._process.stdin.flush()
            for line in self._process.stdout:
                answer = json.loads(line)
                if "done" not in answer:
                    return answer
                moved(answer["done"], answer["total"])
        except (OSError, ValueError):
            pass
        status = self._process.wait()
        return {
            "error": f"{job['notebook']}: the process that ran it ended (status {status}{self._last_words()})",
            "seconds": 0.0,
        }

    def _last_words(self) -> str:
        self._said.seek(0)
        lines = self._said.read().decode(errors="replace").split("\n")
        return next((f": {line.strip()}" for line in reversed(lines) if line.strip()), "")

    def close(self) -> None:
        try:
            self._process.stdin.close()
        except OSError:
            pass

    def wait(self) -> None:
        try:
            self._process.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
