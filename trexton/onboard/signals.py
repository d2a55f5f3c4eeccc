"""SIGINT and SIGTERM end the flight of the script in order; a second one ends it at once.

SIGHUP ends nothing: a terminal that was closed, or a radio link that broke, is only for eyes.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

__all__ = ["Stop", "stopped_by_signals"]


class Stop(threading.Event):
    """An event that a signal handler may set, whatever the thread that it interrupts is at.

    One that waits for a plain event may be interrupted while it holds the event's lock; setting it
    there would wait for that lock for ever. A bare lock may be released at any moment (and
    `queue.SimpleQueue`, which may be entered again, can wait for ever for a timeout that ran out
    while it looked).
    """

    def __init__(self) -> None:
        super().__init__()
        self._is_set, self._closed = False, threading.Lock()
        self._closed.acquire()

    def is_set(self) -> bool:
        return self._is_set

    def set(self) -> None:
        self._is_set = True
        self._open()

    def wait(self, timeout: float | None = None) -> bool:
        if self._closed.acquire(timeout=-1 if timeout is None else max(0.0, timeout)):
            self._open()  # for whoever waits too
        return self._is_set

    def _open(self) -> None:
        with suppress(RuntimeError):  # it was open
            self._closed.release()


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
