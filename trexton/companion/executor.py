"""One seam for many independent things: done here, by processes of this machine, or by a cluster.

Repeats, grids and trials go through `spread`; where they run is settled outside, so that the same
function gives the same values everywhere::

    errors = spread(partial(fly, mission), range(200), "landings")
"""

from __future__ import annotations

import os
import pickle
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from multiprocessing import get_context
from typing import Any, TypeVar

from trexton.base.errors import ParameterError
from trexton.base.progress import progress

__all__ = [
    "CLUSTER", "PROCESSES", "THREAD_VARIABLES", "TLS_VARIABLES", "connect", "end_with_parent",
    "environment", "limited", "limited_threads", "spread", "working_on",
]  # fmt: skip

T = TypeVar("T")
R = TypeVar("R")

# The environment carries the choice to the kernels of notebooks and to worker processes.
CLUSTER, PROCESSES = "TREXTON_CLUSTER", "TREXTON_PROCESSES"
THREAD_VARIABLES = (
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS", "OPENCV_FOR_THREADS_NUM",
)  # fmt: skip
# Dask's own, so that its workers may be given them too: what `Security` calls them, their names.
TLS_VARIABLES = {
    "tls_ca_file": "DASK_DISTRIBUTED__COMM__TLS__CA_FILE",
    "tls_client_cert": "DASK_DISTRIBUTED__COMM__TLS__CLIENT__CERT",
    "tls_client_key": "DASK_DISTRIBUTED__COMM__TLS__CLIENT__KEY",
}
_GREETING_S = 30.0
_task: Callable[[Any], Any] | None = None


@contextmanager
def environment(chosen: Mapping[str, str]) -> Iterator[None]:
    """Within the block these variables hold, in started processes too."""
    before = {name: os.environ.get(name) for name in chosen}
    os.environ |= chosen
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def working_on(cluster: str | None = None, processes: int = 1) -> AbstractContextManager[None]:
    """Within the block, `spread` uses a Dask cluster, so many processes, or (default) neither."""
    return environment({CLUSTER: cluster or "", PROCESSES: str(processes)})


def limited(threads: int | None) -> AbstractContextManager[None]:
    """Within the block, started processes give their libraries so many threads (None: all)."""
    return environment({} if threads is None else dict.fromkeys(THREAD_VARIABLES, str(threads)))


@contextmanager
def limited_threads(count: int) -> Iterator[None]:
    """BLAS, OpenCV and this package's kernels use `count` threads within the block."""
    import cv2
    from threadpoolctl import threadpool_limits

    before = cv2.getNumThreads()
    cv2.setNumThreads(count)
    try:
        with environment({"OMP_NUM_THREADS": str(count)}), threadpool_limits(count):
            yield
    finally:
        cv2.setNumThreads(before)


def end_with_parent() -> None:
    """End this process soon after the one that started it, which may be killed at any moment."""
    parent = os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def spread(function: Callable[[T], R], items: Iterable[T], label: str = "") -> list[R]:
    """``[function(item) for item in items]``, wherever there is room for it.

    Parameters
    ----------
    function : callable
        Picklable, and a function of its item alone: random numbers come from the item's own stream.
    items : iterable
        Picklable.
    label : str
        Names the bar that shows progress.

    Returns
    -------
    list
        Results in the order of `items`.
    """
    items = list(items)
    if address := os.environ.get(CLUSTER):
        return _on_cluster(address, function, items)
    processes = min(int(os.environ.get(PROCESSES) or 1), len(items))
    if processes <= 1:
        return [function(item) for item in progress(items, label, len(items))]
    with ProcessPoolExecutor(
        processes, get_context("spawn"), initializer=_keep, initargs=(function,)
    ) as pool:
        return list(progress(pool.map(_apply, items), label, len(items)))


def _keep(function: Callable[[Any], Any]) -> None:
    """Receive the function once a process: it may carry a map or a floor."""
    global _task
    end_with_parent()
    _task = function


def _apply(item: Any) -> Any:
    assert _task is not None
    return _call(_task, item)


def connect(address: str) -> Any:
    """A client of the Dask scheduler at `address`; raises `ParameterError` if none answers."""
    from distributed import Client, Security
    from distributed.comm.addressing import parse_address, parse_host_port
    from distributed.comm.registry import get_backend

    files = {name: os.environ[key] for name, key in TLS_VARIABLES.items() if key in os.environ}
    try:
        scheme, place = parse_address(address)
        security = Security(**files)
        if scheme == "tls" and not security.get_connection_args("client").get("ssl_context"):
            raise ParameterError(f"{address}: name --tls-ca, --tls-cert and --tls-key")
        get_backend(scheme)  # a client of an unknown one takes minutes to close
        # Where nothing listens it is known at once. A scheduler greets whoever comes: a client of
        # something else, such as a web server, would wait for that for ever.
        if scheme in ("tcp", "tls"):
            with socket.create_connection(parse_host_port(place, 8786), timeout=10) as there:
                there.settimeout(_GREETING_S)
                if scheme == "tcp" and not there.recv(1):
                    raise OSError("it hung up")
        return Client(address, timeout="60s", set_as_default=False, security=security)
    except ParameterError:
        raise
    except (OSError, ValueError) as error:
        raise ParameterError(
            f"no Dask scheduler answers at {address} ({error}): start one with dask scheduler, and "
            "workers with dask worker, in environments with the same trexton"
        ) from None


def _on_cluster(address: str, function: Callable[[T], R], items: list[T]) -> list[R]:
    """Every item a task of its own: a worker that dies costs only what it was at."""
    with connect(address) as client:
        # A task too, and not scattered: what is scattered cannot be made again where the worker
        # that has it dies, and takes with it all that waits for it. As bytes the scheduler, which
        # reads what it is sent, need not know what a worker is to do.
        shipped = client.submit(pickle.loads, pickle.dumps(function), pure=False)
        futures = [client.submit(_call, shipped, item, pure=False) for item in items]
        return list(client.gather(futures))


def _call(function: Callable[[T], R], item: T) -> R:
    """Run one item away from here; whatever is spread inside it is done in place."""
    with working_on():
        return function(item)
