"""Hand tasks to pytask: it decides by content what must run, in which order, and remembers."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytask
from pytask_parallel import ParallelBackend, WorkerType, registry

from trexton.base.errors import TrextonError
from trexton.companion.build import execution
from trexton.companion.build.nodes import HashedNode

__all__ = ["Turns", "build", "task"]

# Counts up whenever results of an older version of this package must not be taken over.
_VERSION = "1"


class _Task(pytask.TaskWithoutPath):
    """A task whose code is among its nodes."""

    def state(self) -> str:
        return _VERSION


def task(
    name: str,
    function: Callable[[], None],
    reads: Sequence[HashedNode],
    leaves: Sequence[HashedNode],
    turn: str | None = None,
) -> pytask.TaskWithoutPath:
    """A task for `build`: `turn` is ``"try_first"``, ``"try_last"`` or None."""
    return _Task(
        name=name,
        function=lambda **_: function(),
        depends_on={"reads": list(reads)},
        produces={"leaves": list(leaves)},
        markers=[pytask.Mark(turn, (), {})] if turn else [],
    )


class Turns:
    """Tasks run beside each other, but what measures time has the machine to itself."""

    def __init__(self) -> None:
        self._condition, self._beside, self._alone = threading.Condition(), 0, False

    @contextmanager
    def turn(self, alone: bool) -> Iterator[None]:
        """Wait for the turn, and hold it for the block."""
        with self._condition:
            self._condition.wait_for(lambda: not self._alone and not (alone and self._beside))
            self._alone, self._beside = alone, self._beside + (not alone)
        try:
            yield
        finally:
            with self._condition:
                self._alone, self._beside = (
                    False if alone else self._alone,
                    self._beside - (not alone),
                )
                self._condition.notify_all()


class _Threads(ThreadPoolExecutor):
    """Threads that wait for kernels; left early (Ctrl-C), the kernels end first."""

    def __init__(self, size: int, stop: Callable[[], None]) -> None:
        super().__init__(size)
        self._stop = stop

    def __exit__(self, *_: object) -> None:
        self._stop()
        self.shutdown(wait=True, cancel_futures=True)


def build(
    tasks: Sequence[pytask.TaskWithoutPath],
    root: Path,
    jobs: int,
    stop: Callable[[], None] = execution.stop_all,
) -> dict[str, Any]:
    """Run what must be run; returns pytask's report of each task by name.

    Parameters
    ----------
    root : Path
        Folder of the engine's memory, ``pytask.lock``.
    jobs : int
        Tasks at once.
    stop : callable
        Ends what is running when the run is interrupted.

    Raises
    ------
    KeyboardInterrupt
        The run was interrupted; what was finished is remembered.
    TrextonError
        The engine could not start.
    """
    root.mkdir(parents=True, exist_ok=True)
    config = root / "pyproject.toml"
    config.write_text("[tool.pytask.ini_options]\n", encoding="utf-8")
    registry.register_parallel_backend(
        ParallelBackend.CUSTOM,
        lambda n_workers: _Threads(n_workers, stop),
        worker_type=WorkerType.THREADS,
        remote=False,
    )
    quiet, pytask.console.quiet = pytask.console.quiet, True
    try:
        session = pytask.build(
            tasks=list(tasks), config=config, paths=[root], capture="no", verbose=0,
            parallel_backend="custom", n_workers=jobs, disable_warnings=True,
        )  # fmt: skip
    finally:
        pytask.console.quiet = quiet
    reports = {report.task.name: report for report in session.execution_reports}
    if not reports.keys() >= {each.name for each in tasks}:
        if session.exit_code in (pytask.ExitCode.CONFIGURATION_FAILED, pytask.ExitCode.DAG_FAILED):
            raise TrextonError(f"the workflow engine could not start ({session.exit_code.name})")
        raise KeyboardInterrupt
    return reports
