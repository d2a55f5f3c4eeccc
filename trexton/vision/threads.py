"""Work of one frame spread over the processor's cores: equal strips of rows, a thread each.

Offers `in_strips` for kernels and products that release Python's lock, and how many cores there are
to use.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import TypeVar

__all__ = ["in_strips", "thread_count", "usable_cores"]

T = TypeVar("T")


def usable_cores() -> int:
    """The processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def thread_count() -> int:
    """``$OMP_NUM_THREADS``, else the processors that this process may use."""
    given = os.environ.get("OMP_NUM_THREADS", "")
    return int(given) if given.isdecimal() and int(given) else usable_cores()


def in_strips(work: Callable[[slice], T], rows: int) -> list[T]:
    """Call `work` on equal slices of `rows` rows, one a thread; kernels and products release
    Python's lock.

    Threads live for one call only: a pool kept would not survive a fork, and would spin or sleep
    beside the BLAS's own.
    """
    strips = min(thread_count(), rows)
    bounds = [rows * i // strips for i in range(strips + 1)]
    slices = [slice(first, last) for first, last in zip(bounds, bounds[1:], strict=False)]
    if strips == 1:
        return [work(slices[0])]
    from concurrent.futures import ThreadPoolExecutor  # it takes a while to load

    with ThreadPoolExecutor(strips - 1) as pool:
        waiting = [pool.submit(work, strip) for strip in slices[1:]]
        return [work(slices[0]), *(future.result() for future in waiting)]
