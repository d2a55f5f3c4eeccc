"""What people read while the vehicle flies: lines on standard error that hold nothing up.

A terminal that sleeps, a pipe nobody reads, a reader that has gone: none of them may delay a
position or end the flight. A thread does the writing; what it cannot keep up with is left out.
"""

from __future__ import annotations

import os
import queue
import sys
import threading
import time
from contextlib import suppress

from trexton.base.progress import is_quiet, shown

__all__ = ["Voice", "flush", "say"]


class Voice:
    """Writes lines in a thread of its own.

    Parameters
    ----------
    size : int
        Lines that may wait; further ones are left out.
    """

    def __init__(self, size: int = 256):
        self._lines: queue.Queue[str] = queue.Queue(size)
        self._thread: threading.Thread | None = None
        self._lock = threading.Lock()

    def say(self, line: str) -> None:
        """Have one line written; never waits."""
        with self._lock:
            if self._thread is None:
                self._thread = threading.Thread(target=self._write_all, name="voice", daemon=True)
                self._thread.start()
        with suppress(queue.Full):
            self._lines.put_nowait(line)

    def flush(self, patience: float = 0.5) -> None:
        """Wait until everything is written, but not longer than `patience` seconds."""
        end = time.monotonic() + patience
        while self._lines.unfinished_tasks and time.monotonic() < end:
            time.sleep(0.002)

    def _write_all(self) -> None:
        while True:
            line = self._lines.get()
            with suppress(OSError, ValueError):  # nobody reads: it is only for eyes
                _write(line + "\n")
            self._lines.task_done()


def _write(text: str) -> None:
    """Past Python's buffer, whose lock a blocked write would hold when the process ends."""
    stream = sys.stderr
    if stream is None:
        return
    try:
        descriptor = stream.fileno()
    except (OSError, ValueError, AttributeError):  # not a file: what a test or a notebook put there
        stream.write(text)
        return
    data = text.encode(errors="replace")
    while data:
        data = data[os.write(descriptor, data) :]


_VOICE = Voice()  # standard error is one for the process, and so is what writes to it


def say(line: str) -> None:
    """One line for people, unless the command is quiet; never waits, never fails."""
    if not is_quiet():
        _VOICE.say(shown(line, kept=""))


def flush(patience: float = 0.5) -> None:
    """Give what was said time to be written, but no more than `patience` seconds."""
    _VOICE.flush(patience)
