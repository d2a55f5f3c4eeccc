"""Where steps run: kernels and processes of this machine; cells of a sweep on a Dask cluster too.

Offers `jobs_here`, `callers`, and `connect`, a client of a cluster.
"""

import resource
import socket
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import psutil

import trexton
from trexton.base.errors import ParameterError, TrextonError
from trexton.base.files import digest
from trexton.base.options import whole
from trexton.base.records import software_versions
from trexton.companion.executor import end_with_parent, limited
from trexton.vision.threads import usable_cores

_MEMORY_PER_JOB = 2 * 2**30
_OPEN_FILES = 256  # a run has more sockets and pipes than a shell's worth
_HOME_BYTES = 2**16
_GREETING_S = 30.0
Call = Callable[..., Any]
Stop = Callable[[], None]


def jobs_here(jobs: int | None, most: int) -> int:
    """How many notebooks at once: `jobs`, else as many as this machine has processors and memory
    for, and no more than there are steps, `most`.

    Raises
    ------
    ParameterError
        `jobs` is below 1.
    TrextonError
        This machine allows too few open files, or there is no home folder to write to.
    """
    _check_surroundings()
    room = psutil.virtual_memory().available // _MEMORY_PER_JOB
    return max(1, min(usable_cores(), room, most)) if jobs is None else whole(jobs, "jobs")


def threads_of(jobs: int) -> int | None:
    """The threads of one of so many `jobs`: a share, or all (None) where it is alone."""
    return None if jobs == 1 else max(1, usable_cores() // jobs)


@contextmanager
def callers(cluster: str | None, jobs: int | None) -> Iterator[tuple[int, Call, Stop]]:
    """How many at once, what calls a function of plain arguments, in a process of this machine or
    on a Dask cluster, and what ends the waiting.

    Raises
    ------
    ParameterError
        No scheduler answers, it has no workers, or a worker has another version of this package;
        `jobs` is below 1.
    """
    if cluster is None:
        count = jobs_here(jobs, usable_cores())
        with limited(threads_of(count)):
            pool = ProcessPoolExecutor(count, get_context("spawn"), initializer=end_with_parent)
            try:
                yield count, lambda do, *words: pool.submit(do, *words).result(), lambda: None
            finally:
                pool.shutdown(wait=True, cancel_futures=True)
        return
    client = connect(cluster)

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
        yield count if jobs is None else whole(jobs, "jobs"), call, client.close
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
