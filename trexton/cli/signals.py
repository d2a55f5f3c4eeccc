"""SIGINT and SIGTERM end the flight of the script in order; a second one ends it at once.

SIGHUP ends nothing: a terminal that was closed, or a radio link that broke, is only for eyes.
"""

from __future__ import annotations

import _thread
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

__all__ = ["set_elsewhere", "stopped_by_signals"]


def set_elsewhere(event: threading.Event) -> None:
    """Set an event from a signal handler, whatever the thread that it interrupts is at.

    That one may hold the event's lock, and setting it there would wait for that lock for ever: a
    thread of its own waits instead, begun without any lock.
    """
    _thread.start_new_thread(event.set, ())


@contextmanager
def stopped_by_signals() -> Iterator[threading.Event]:
    """An event that the first SIGINT or SIGTERM sets; then, or afterwards, the usual handlers are
    back."""
    stop = threading.Event()
    endings = (signal.SIGINT, signal.SIGTERM)
    before = {number: signal.getsignal(number) for number in (*endings, signal.SIGHUP)}

    def restore() -> None:
        for number in endings:
            signal.signal(number, before[number])

    def handle(number: int, frame: FrameType | None) -> None:
        set_elsewhere(stop)
        restore()

    for number in endings:
        signal.signal(number, handle)
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        yield stop
    finally:
        restore()
        signal.signal(signal.SIGHUP, before[signal.SIGHUP])
