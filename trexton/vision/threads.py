"""Work of one frame spread over the processor's cores: equal strips of rows, a thread each.

Offers `in_strips` for kernels that release Python's lock, `ahead` for products that do, and for
frames that are decoded in order while others are worked on, and how many cores there are to use.
"""

import os
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

S = TypeVar("S")
T = TypeVar("T")
_THIS = threading.local()  # thread


def usable_cores() -> int:
    """The processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def thread_count() -> int:
    """``$OMP_NUM_THREADS``, else the processors that this process may use; 1 within a thread of
    this module's, which has the others beside it.
    """
    if getattr(_THIS, "works", False):
        return 1
    given = os.environ.get("OMP_NUM_THREADS", "")
    return int(given) if given.isdecimal() and int(given) else usable_cores()


def in_strips(work: Callable[[slice], T], rows: int) -> list[T]:
    """Call `work` on equal slices of `rows` rows, one a thread."""
    strips = min(thread_count(), rows)
    slices = (slice(rows * i // strips, rows * (i + 1) // strips) for i in range(strips))
    return list(ahead(work, slices))


def ahead(work: Callable[[S], T], items: Iterable[S]) -> Iterator[T]:
    """`work` of each of the items in order: they are taken in this thread, and worked on in
    others, two for each of them at a time.

    Threads live for one call only: a pool kept would not survive a fork, and would spin or sleep
    beside the BLAS's own.
    """
    others = thread_count()
    if others < 2:
        yield from map(work, items)
        return
    from concurrent.futures import Future, ThreadPoolExecutor  # they take a while to load

    waiting: deque[Future[T]] = deque()
    with ThreadPoolExecutor(others, initializer=setattr, initargs=(_THIS, "works", True)) as pool:
        for item in items:
            waiting.append(pool.submit(work, item))
            if len(waiting) > 2 * others:
                yield waiting.popleft().result()
        for future in waiting:
            yield future.result()
