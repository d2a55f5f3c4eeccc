"""What went wrong and what was done about it: counted in one place, shown once a second."""

from __future__ import annotations

import threading
from collections import Counter, deque

import numpy as np

from trexton.base.errors import ParameterError

__all__ = ["FAULTS", "Latencies", "Tally"]

# What each is, and what is done about it, stands in the book, on the page "On board".
FAULTS = (
    "camera", "gap", "corrupt", "size", "dark", "bright", "frozen", "torn", "misfit", "velocity",
    "attitude", "late", "clock", "output", "link", "silent",
)  # fmt: skip


class Tally:
    """Thread-safe counts of faults and of everything else worth counting."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._faults: Counter[str] = Counter()
        self._counts: Counter[str] = Counter()

    def fault(self, name: str, count: int = 1) -> None:
        """Count a fault of `FAULTS`."""
        if name not in FAULTS:
            raise ParameterError(f"fault {name!r} is unknown: name it in FAULTS")
        with self._lock:
            self._faults[name] += count

    def count(self, name: str, count: int = 1) -> None:
        """Count anything else: frames, dropped frames, messages."""
        with self._lock:
            self._counts[name] += count

    def __getitem__(self, name: str) -> int:
        with self._lock:
            return (self._faults if name in FAULTS else self._counts)[name]

    @property
    def faults(self) -> dict[str, int]:
        """The faults seen so far, in the order of `FAULTS`."""
        with self._lock:
            return {name: self._faults[name] for name in FAULTS if self._faults[name]}


class Latencies:
    """The latest `size` latencies in seconds, in constant memory."""

    def __init__(self, size: int = 65536):
        self._latest: deque[float] = deque(maxlen=size)
        self.longest = 0.0

    def add(self, seconds: float) -> None:
        """Take one in, over the oldest."""
        self._latest.append(seconds)
        self.longest = max(self.longest, seconds)

    def quantile(self, share: float) -> float:
        """The latency that this share of the latest ones does not exceed; NaN before the first."""
        return float(np.quantile(self._latest, share)) if self._latest else float("nan")
