"""What went wrong and what was done about it: counted in one place, shown once a second."""

from __future__ import annotations

import threading
from collections import Counter

__all__ = ["FAULTS", "Tally"]

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
