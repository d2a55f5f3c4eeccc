"""What went wrong and what was done about it: counted in one place, shown once a second."""

from __future__ import annotations

import threading
from collections import Counter, deque

import numpy as np

from trexton.base.errors import ParameterError

__all__ = ["FAULTS", "Latencies", "Tally"]

# name: what the loop does about it
FAULTS = {
    "camera": "no camera, or it fell silent: predict only, mark stale, "
    "open it again after a growing pause",
    "gap": "no frame in time: predict only, mark stale after a while",
    "corrupt": "a frame that cannot be decoded: predict only",
    "size": "a frame of another size than the map's: predict only",
    "dark": "a black frame: predict only",
    "bright": "a saturated frame: predict only",
    "frozen": "the same frame again: predict only, open the camera again if it stays",
    "torn": "a frame that is in part the one before: predict only",
    "misfit": "a frame the map cannot use: predict only",
    "velocity": "a velocity that the frames contradict, the camera's or the autopilot's: "
    "it is taken for wrong, its error learned",
    "attitude": "a roll or pitch that the frames contradict: how far it is off is learned",
    "late": "a report later than the rate allows: sent with its own stamp, older frames dropped",
    "clock": "a clock that jumped: the stamp is replaced, and stamps go on increasing",
    "output": "an output failed (disk full, pipe closed): the rest goes on, "
    "it is tried again later",
    "link": "the autopilot's link failed: the rest goes on, "
    "it is opened again after a growing pause",
    "silent": "the autopilot was heard and fell silent: positions go on being sent, and it is said",
}


class Tally:
    """Thread-safe counts of faults and of everything else worth counting."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._faults: Counter[str] = Counter()
        self._counts: Counter[str] = Counter()

    def fault(self, name: str, count: int = 1) -> None:
        """Count a fault of `FAULTS`."""
        if name not in FAULTS:
            raise ParameterError(
                f"fault {name!r} is unknown: name it in FAULTS with what is done about it"
            )
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
