"""What went wrong is counted in one place, and lines for people hold nothing up.

A terminal that sleeps, a pipe nobody reads, a reader that has gone: none of them may delay a
position or end the flight. A thread does the writing; what it cannot keep up with is left out.
"""

import os
import queue
import sys
import threading
import time
from collections import Counter
from contextlib import suppress

from trexton.base.progress import is_quiet, shown

# What each is, and what is done about it, stands in the book, on the page "On board".
FAULTS = (
    "camera", "gap", "corrupt", "size", "dark", "bright", "frozen", "misfit", "velocity",
    "attitude", "late", "clock", "output", "link",
)  # fmt: skip


class Tally:
    """Thread-safe counts of faults, and of frames and messages."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._counts: Counter[str] = Counter()

    def count(self, name: str, count: int = 1) -> None:
        """Count a fault of `FAULTS`, or anything else."""
        with self._lock:
            self._counts[name] += count

    def __getitem__(self, name: str) -> int:
        return self._counts[name]

    @property
    def faults(self) -> dict[str, int]:
        """The faults seen so far, in the order of `FAULTS`."""
        return {name: self[name] for name in FAULTS if self[name]}


_lines: queue.Queue[str] = queue.Queue(256)  # what comes while it is full is left out
_begun = threading.Lock()  # whoever speaks first takes it, and keeps it


def say(line: str) -> None:
    """One line for people, unless the command is quiet; never waits, never fails."""
    if not is_quiet():
        if _begun.acquire(blocking=False):
            threading.Thread(target=_write_all, name="voice", daemon=True).start()
        with suppress(queue.Full):
            _lines.put_nowait(shown(line, kept=""))


def flush(patience: float = 0.5) -> None:
    """Give what was said time to be written, but no more than `patience` seconds."""
    end = time.monotonic() + patience
    while _lines.unfinished_tasks and time.monotonic() < end:
        time.sleep(0.002)


def _write_all() -> None:
    while True:
        line = _lines.get()
        with suppress(OSError, ValueError):  # nobody reads: it is only for eyes
            _write(line + "\n")
        _lines.task_done()


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
