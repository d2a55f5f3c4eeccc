"""Where steps run: kernels and processes of this machine, or the workers of a Dask cluster."""

from __future__ import annotations

import resource
import tempfile
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import psutil

from trexton.base.cache import code_hashes
from trexton.base.errors import ParameterError, TrextonError
from trexton.base.files import digest
from trexton.base.options import whole
from trexton.base.progress import say
from trexton.base.records import software_versions
from trexton.companion.build import execution
from trexton.companion.build.execution import Done, Job
from trexton.companion.executor import connect, end_with_parent, limited
from trexton.companion.experiments.registry import MODULES
from trexton.vision.threads import usable_cores

__all__ = ["Call", "Workers", "modules_of_runs", "workers"]

_MEMORY_PER_JOB = 2 * 2**30
_OPEN_FILES = 256  # a run has more sockets and pipes than a shell's worth
_HOME_BYTES = 2**16
_WATCH_S = 30.0  # seconds between checks that the cluster still has workers
Call = Callable[..., Any]


@dataclass(frozen=True)
class Workers:
    """So many `jobs` at once, here or at `cluster`; `stop` ends what is running."""

    jobs: int
    stop: Callable[[], None] = execution.stop_all
    cluster: str = ""
    _call: Call | None = None

    def threads(self, alone: bool) -> int | None:
        """The threads of a kernel: a share, or all (None) where it is alone."""
        return None if alone or self.jobs == 1 else max(1, usable_cores() // self.jobs)

    def run(self, job: Job, report: Callable[[int, int], None]) -> Done:
        """Execute a notebook; on a cluster its cells are counted where it runs."""
        return execution.execute(job, report) if self._call is None else self._call(_seceded, job)

    @contextmanager
    def calls(self) -> Iterator[Call]:
        """Calls a function of plain arguments: in a process of this machine, or on the cluster."""
        if self._call is not None:
            yield self._call
            return
        with limited(self.threads(alone=False)):
            pool = ProcessPoolExecutor(self.jobs, get_context("spawn"), initializer=end_with_parent)
            try:
                yield lambda function, *words: pool.submit(function, *words).result()
            finally:
                pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def workers(cluster: str | None, jobs: int | None, most: int | None = None) -> Iterator[Workers]:
    """This machine's (as many at once as it has processors and memory for, and no more than there
    are steps, `most`), or the cluster's.

    Raises
    ------
    ParameterError
        No scheduler answers, it has no workers, or a worker has another version of this package;
        `jobs` is below 1.
    TrextonError
        This machine allows too few open files, or there is no home folder to write to.
    """
    if jobs is not None:
        whole(jobs, "jobs")
    _check_surroundings()
    if cluster is None:
        room = psutil.virtual_memory().available // _MEMORY_PER_JOB
        yield Workers(jobs or max(1, min(usable_cores(), room, most or room)))
        return
    client = connect(cluster)

    def stop() -> None:
        if client.status == "running":
            client.run(execution.stop_all)
            client.close()

    try:
        count = _checked(client, cluster)
        yield Workers(jobs or count, stop, cluster, _patient(client, cluster))
    finally:
        client.close()


def _check_surroundings() -> None:
    """Notebooks die without a word where files may not be opened or their home is full."""
    _, most = resource.getrlimit(resource.RLIMIT_NOFILE)
    if 0 <= most < _OPEN_FILES:
        raise TrextonError(f"{most} open files are allowed: say ulimit -n {4 * _OPEN_FILES} first")
    home = Path.home()
    try:
        with tempfile.TemporaryFile(dir=home) as stream:
            stream.write(bytes(_HOME_BYTES))
    except OSError as error:
        raise TrextonError(
            f"{home}: the home folder cannot be written to ({error.strerror}), as notebooks must: "
            "make room, or set HOME to another folder"
        ) from None


def _checked(client: Any, cluster: str) -> int:
    """How many workers there are, all of them with this environment."""
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
    return len(prints)


def _patient(client: Any, cluster: str) -> Call:
    """Calls on the cluster, which wait with a word where no worker is left."""
    warned = threading.Event()

    def call(function: Call, *words: object) -> Any:
        try:
            future = client.submit(function, *words, pure=False)
            while True:
                try:
                    return future.result(timeout=_WATCH_S)
                except TimeoutError:
                    if future.done():  # meanwhile, or by a timeout of its own
                        return future.result()
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

    return call


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
