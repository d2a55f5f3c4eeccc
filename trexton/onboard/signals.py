"""SIGINT and SIGTERM end the flight of the script in order; a second one ends it at once.

SIGHUP ends nothing: a terminal that was closed, or a radio link that broke, is only for eyes.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from queue import Empty, SimpleQueue
from types import FrameType

__all__ = ["Stop", "stopped_by_signals"]


class Stop(threading.Event):
    """An event that a signal handler may set, whatever the thread that it interrupts is at.

    One that waits for a plain event may be interrupted while it holds the event's lock; setting it
    there would wait for that lock for ever. A `SimpleQueue` may be entered again.
    """

    def __init__(self) -> None:
        super().__init__()
        self._is_set, self._told = False, SimpleQueue[None]()

    def is_set(self) -> bool:
        return self._is_set

    def set(self) -> None:
        self._is_set = True
        self._told.put(None)

    def wait(self, timeout: float | None = None) -> bool:
        with suppress(Empty):
            self._told.get(timeout=None if timeout is None else max(0.0, timeout))
            self._told.put(None)  # for whoever waits too
        return self._is_set


@contextmanager
def stopped_by_signals() -> Iterator[threading.Event]:
    """An event that the first SIGINT or SIGTERM sets; then, or afterwards, the usual handlers are
    back."""
    stop = Stop()
    endings = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.getsignal(number) for number in (*endings, signal.SIGHUP)}

    def restore() -> None:
        for number in endings:
            signal.signal(number, before[number])

    def handle(number: int, frame: FrameType | None) -> None:
        stop.set()
        restore()

    for number in endings:
        signal.signal(number, handle)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        yield stop
    finally:
        restore()
        signal.signal(signal.SIGHUP, before[signal.SIGHUP])
