"""Where steps run: kernels and processes of this machine, or the workers of a Dask cluster.

Offers `workers`, and `connect`, a client of a cluster.
"""

from __future__ import annotations

import resource
import socket
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import psutil

import trexton
from trexton.base.errors import ParameterError, TrextonError
from trexton.base.files import digest
from trexton.base.options import whole
from trexton.base.records import software_versions
from trexton.companion.build import execution
from trexton.companion.build.execution import Done, Job
from trexton.companion.executor import end_with_parent, limited
from trexton.vision.threads import usable_cores

__all__ = ["Call", "Workers", "connect", "workers"]

_MEMORY_PER_JOB = 2 * 2**30
_OPEN_FILES = 256  # a run has more sockets and pipes than a shell's worth
_HOME_BYTES = 2**16
_GREETING_S = 30.0
Call = Callable[..., Any]


@dataclass(frozen=True)
class Workers:
    """So many `jobs` at once, here or (`call`) on a cluster; `stop` ends what is running."""

    jobs: int
    stop: Callable[[], None] = execution.stop_all
    call: Call | None = None

    def threads(self, alone: bool) -> int | None:
        """The threads of a kernel: a share, or all (None) where it is alone."""
        return None if alone or self.jobs == 1 else max(1, usable_cores() // self.jobs)

    def run(self, job: Job) -> Done:
        """Execute a notebook."""
        if self.call is None:
            return execution.execute(job)
        done: Done = self.call(execution.execute, job)
        return done

    @contextmanager
    def calls(self) -> Iterator[Call]:
        """Calls a function of plain arguments: in a process of this machine, or on the cluster."""
        if self.call is not None:
            yield self.call
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

    def call(function: Call, *words: object) -> Any:
        try:
            return client.submit(function, *words, pure=False).result()
        except Exception as error:
            if client.status == "running" and not isinstance(error, CancelledError):
                raise
            raise TrextonError(
                f"the Dask scheduler at {cluster} was lost: start it and its workers, and "
                "repeat the command, what was finished is kept"
            ) from error

    try:
        count = _checked(client, cluster)
        yield Workers(jobs or count, stop, call)
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


def connect(address: str) -> Any:
    """A client of the Dask scheduler at `address`; raises `ParameterError` if none answers."""
    from distributed import Client, Security
    from distributed.comm.addressing import parse_address, parse_host_port
    from distributed.comm.registry import get_backend

    try:
        scheme, place = parse_address(address)
        if scheme == "tls" and not Security().get_connection_args("client").get("ssl_context"):
            raise ParameterError(f"{address}: name --tls-ca, --tls-cert and --tls-key")
        get_backend(scheme)  # a client of an unknown one takes minutes to close
        # Where nothing listens it is known at once. A scheduler greets whoever comes: a client of
        # something else, such as a web server, would wait for that for ever.
        if scheme in ("tcp", "tls"):
            with socket.create_connection(parse_host_port(place, 8786), timeout=10) as there:
                there.settimeout(_GREETING_S)
                if scheme == "tcp" and not there.recv(1):
                    raise OSError("it hung up")
        return Client(address, timeout="60s", set_as_default=False)
    except ParameterError:
        raise
    except (OSError, ValueError) as error:
        raise ParameterError(
            f"no Dask scheduler answers at {address} ({error}): start one with dask scheduler, and "
            "workers with dask worker, in environments with the same trexton"
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


def _fingerprint() -> str:
    """Of all code of this package, and of the versions below it."""
    return digest(*sorted(Path(trexton.__file__).parent.rglob("*.py")), software_versions())
