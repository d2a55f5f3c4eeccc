"""Hot loops compiled by numba, one a file, loaded on first use; each has a NumPy twin of the same
bits.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from functools import cache
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING, TypeVar

from trexton.base.errors import ParameterError

# Names them for the cache too, which follows imports to know what code a result depends on.
if TYPE_CHECKING:
    from trexton.vision.kernels import kohonen_steps, label_rows, nearest_in_tree  # noqa: F401

__all__ = ["BACKENDS", "compiled", "in_strips", "thread_count", "usable_cores"]

T = TypeVar("T")
BACKENDS = ("numba", "numpy")


@cache
def _load(module: str) -> ModuleType | None:
    try:
        return import_module(f"trexton.vision.kernels.{module}")
    except (ImportError, RuntimeError):  # numba is absent, or finds no folder for its cache
        return None


def compiled(module: str, backend: str | None = None) -> ModuleType | None:
    """A module of this package with its compiled kernels, or None where NumPy shall do the work.

    Parameters
    ----------
    module : str
    backend : {"numba", "numpy"} or None
        None takes numba where it is installed.

    Raises
    ------
    ParameterError
        The backend is unknown, or is numba and numba is not installed.
    """
    if backend not in (None, *BACKENDS):
        raise ParameterError(f"backend {backend!r} is unknown: choose one of {', '.join(BACKENDS)}")
    kernels = None if backend == "numpy" else _load(module)
    if kernels is None and backend == "numba":
        raise ParameterError(
            "backend 'numba' was asked for, but cannot be loaded: install it or take 'numpy'"
        )
    return kernels


def usable_cores() -> int:
    """The processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def thread_count(threads: int | None = None) -> int:
    """How many threads to use: `threads`, else ``$OMP_NUM_THREADS``, else the processors of this
    process.
    """
    if threads is None:
        given = os.environ.get("OMP_NUM_THREADS", "")
        if given.isdecimal() and int(given):
            return int(given)
        return usable_cores()
    if threads < 1:
        raise ParameterError(f"threads is {threads}: expected at least 1")
    return threads


def in_strips(work: Callable[[slice], T], rows: int, threads: int | None = None) -> list[T]:
    """Call `work` on equal slices of `rows` rows, one a thread; kernels and products release
    Python's lock.

    Threads live for one call only: a pool kept would not survive a fork, and would spin or sleep
    beside the BLAS's own.
    """
    strips = min(thread_count(threads), rows)
    bounds = [rows * i // strips for i in range(strips + 1)]
    slices = [slice(first, last) for first, last in zip(bounds, bounds[1:], strict=False)]
    if strips == 1:
        return [work(slices[0])]
    from concurrent.futures import ThreadPoolExecutor  # it takes a while to load

    with ThreadPoolExecutor(strips - 1) as pool:
        waiting = [pool.submit(work, strip) for strip in slices[1:]]
        return [work(slices[0]), *(future.result() for future in waiting)]
