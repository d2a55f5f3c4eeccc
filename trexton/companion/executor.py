"""One seam for many independent things. They are done here, or by processes of this machine.

Repeats, grids and trials go through `spread`; where they run is settled outside, so that the same
function gives the same values everywhere::

    errors = spread(partial(fly, mission), range(200), "landings")
"""

import os
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from contextlib import AbstractContextManager, contextmanager
from multiprocessing import get_context, parent_process
from typing import Any, TypeVar

from trexton.base.progress import progress

T = TypeVar("T")
R = TypeVar("R")

# The environment carries the choice to the kernels of notebooks and to worker processes.
PROCESSES = "TREXTON_PROCESSES"
THREAD_VARIABLES = (
    "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS", "OPENCV_FOR_THREADS_NUM",
)  # fmt: skip
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


def working_on(processes: int = 1) -> AbstractContextManager[None]:
    """Within the block, `spread` uses so many processes of this machine."""
    return environment({PROCESSES: str(processes)})


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
    """End this process with the one that started it, which may be killed even before this."""
    parent = parent_process()
    assert parent is not None, "this process was not started by multiprocessing"

    def watch() -> None:
        parent.join()
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
    """
    return list(spreading(function, items, label))


def spreading(function: Callable[[T], R], items: Iterable[T], label: str = "") -> Iterator[R]:
    """As `spread`, each result as soon as it and those before it are there."""
    items = list(items)
    processes = min(int(os.environ.get(PROCESSES) or 1), len(items))
    if processes <= 1:
        yield from map(function, progress(items, label, len(items)))
        return
    with ProcessPoolExecutor(
        processes, get_context("spawn"), initializer=_keep, initargs=(function,)
    ) as pool:
        yield from progress(pool.map(_apply, items), label, len(items))


def _keep(function: Callable[[Any], Any]) -> None:
    """Receive the function once a process: it may carry a map or a floor."""
    global _task
    end_with_parent()
    _task = function


def _apply(item: Any) -> Any:
    assert _task is not None
    with working_on():  # whatever is spread inside an item is done in place
        return _task(item)
