"""Where notebooks run: kernels of this machine, or the workers of a Dask cluster."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from trexton.base.cache import code_hashes
from trexton.base.errors import ParameterError, TrextonError
from trexton.base.files import digest
from trexton.base.options import whole
from trexton.base.progress import say
from trexton.base.records import software_versions
from trexton.companion.build import execution
from trexton.companion.build.execution import Done, Job
from trexton.companion.executor import connect
from trexton.companion.experiments.registry import MODULES
from trexton.vision.threads import usable_cores

__all__ = ["Workers", "default_jobs", "modules_of_runs", "workers"]

_MEMORY_PER_JOB = 2 * 2**30
_WATCH_S = 30.0  # seconds between checks that the cluster still has workers
Report = Callable[[int, int], None]


@dataclass(frozen=True)
class Workers:
    """Runs jobs, so many at once; `stop` ends what is running."""

    jobs: int
    run: Callable[[Job, Report], Done]
    stop: Callable[[], None]
    cluster: str = ""
    call: Callable[..., Any] = lambda function, *words: function(*words)

    def threads(self, alone: bool) -> int | None:
        """The threads of a kernel: a share, or all where it is alone."""
        return None if alone else max(1, usable_cores() // self.jobs)


@contextmanager
def workers(cluster: str | None, jobs: int | None) -> Iterator[Workers]:
    """This machine's, or those of the cluster at that address.

    Raises
    ------
    ParameterError
        No scheduler answers, it has no workers, or a worker has another version of this package;
        `jobs` is below 1.
    """
    if jobs is not None:
        whole(jobs, "jobs")
    if cluster is None:
        yield Workers(jobs or default_jobs(), execution.execute, execution.stop_all)
        return
    client = connect(cluster)
    try:
        try:
            prints = client.run(_fingerprint)
        except Exception as error:  # what the worker says who lacks a module, as Dask wraps it
            raise ParameterError(
                f"a worker of {cluster} does not run this trexton ({error}): give all workers this "
                "environment"
            ) from None
        if not prints:
            raise ParameterError(f"{cluster} has no workers: start some with dask worker {cluster}")
        if others := [name for name, print_ in prints.items() if print_ != _fingerprint()]:
            raise ParameterError(
                f"the worker {others[0]} has another version of trexton or of what it stands on: "
                "its results would differ; give all workers this environment"
            )

        warned = threading.Event()

        def call(function: Callable[..., Any], *words: object) -> Any:
            try:
                future = client.submit(function, *words, pure=False)
                while True:
                    try:
                        return future.result(timeout=_WATCH_S)
                    except TimeoutError:
                        if future.done():  # its own
                            raise
                    if not client.scheduler_info()["workers"] and not warned.is_set():
                        warned.set()
                        say(
                            f"{cluster} has no workers left: start some, or interrupt; what was "
                            "finished is kept"
                        )
            except Exception as error:
                if client.status == "running" and not isinstance(error, CancelledError):
                    raise
                raise TrextonError(
                    f"the Dask scheduler at {cluster} was lost: start it and its workers, and "
                    "repeat the command, what was finished is kept"
                ) from error

        def run(job: Job, report: Report) -> Done:
            del report  # cells are counted where they run
            done: Done = call(_seceded, job)
            return done

        def stop() -> None:
            if client.status == "running":
                client.run(execution.stop_all)
                client.close()

        yield Workers(jobs or len(prints), run, stop, cluster, call)
    finally:
        client.close()


def _seceded(job: Job) -> Done:
    """Leave the worker's slot to what the notebook spreads: it mostly waits for its kernel."""
    from distributed import secede

    secede()
    return execution.execute(job)


def modules_of_runs() -> dict[str, str]:
    """SHA-256 of every module that a notebook or a cell of a sweep may run."""
    hashes: dict[str, str] = {}
    for name in (*MODULES.values(), "trexton.localization.localizer", execution.__name__):
        hashes |= code_hashes(name)
    return hashes


def _fingerprint() -> str:
    return digest(modules_of_runs(), software_versions())


def default_jobs() -> int:
    """As many notebooks at once as there are processors and memory for."""
    return max(1, min(usable_cores(), _available_memory() // _MEMORY_PER_JOB))


def _available_memory() -> int:
    """Bytes that programs can still take, what the system only caches included."""
    try:
        lines = Path("/proc/meminfo").read_text().splitlines()
        return next(
            int(line.split()[1]) * 1024 for line in lines if line.startswith("MemAvailable")
        )
    except (OSError, StopIteration):
        return usable_cores() * _MEMORY_PER_JOB  # not Linux: go by the processors
