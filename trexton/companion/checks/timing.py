"""Timing: contestants in turn, round after round, in one process; and the rows that come of it.

Offers `interleave` and its `Times`, and `Row`, a stage beside a yardstick of the same run.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from trexton.companion.wording import duration

__all__ = ["Row", "Times", "interleave", "table"]

_PAUSE = 0.05  # seconds; threads of a BLAS spin for about as long after their last product


@dataclass(frozen=True)
class Times:
    """Seconds a call took: median and 99th percentile of all repeats."""

    median: float
    p99: float
    repeats: int

    @classmethod
    def of(cls, seconds: Any) -> Times:
        return cls(float(np.median(seconds)), float(np.percentile(seconds, 99)), len(seconds))


@dataclass(frozen=True)
class Row:
    """One stage beside one yardstick of the same run.

    Attributes
    ----------
    stage, size : str
    threads : int
    ours : Times
    yardstick : str
    yardstick_s : float
        Seconds that it took, the median.
    limit : float or None
        What the ratio must not exceed.
    note : str
    """

    stage: str
    size: str
    threads: int
    ours: Times
    yardstick: str
    yardstick_s: float
    limit: float | None = None
    note: str = ""

    @property
    def ratio(self) -> float:
        """Ours over the yardstick."""
        return self.ours.median / self.yardstick_s

    @property
    def holds(self) -> bool | None:
        """Whether the limit holds; None where there is none."""
        return None if self.limit is None else self.ratio <= self.limit

    def as_dict(self) -> dict[str, Any]:
        """As JSON has it, medians in seconds."""
        return {
            "stage": self.stage, "size": self.size, "threads": self.threads,
            "ours_s": self.ours.median, "p99_s": self.ours.p99, "yardstick": self.yardstick,
            "yardstick_s": self.yardstick_s, "ratio": self.ratio, "limit": self.limit,
            "holds": self.holds, "note": self.note,
        }  # fmt: skip


def interleave(
    contestants: Mapping[str, Callable[[], object]],
    seconds: float = 1.0,
    rounds: int = 9,
    pause: bool = False,
) -> dict[str, Times]:
    """Time calls in turn, so that whatever else the machine does falls on all of them alike.

    Parameters
    ----------
    contestants : dict of str to callable
        Each is called twice to warm up.
    seconds : float
        For each of them, about.
    rounds : int
        At least so many turns, fewer calls in each.
    pause : bool
        Sleep between turns until the threads of a BLAS have gone to sleep too.
    """
    chunk: dict[str, int] = {}
    taken: dict[str, list[float]] = {name: [] for name in contestants}
    for name, call in contestants.items():
        call()
        start = time.perf_counter()
        call()
        chunk[name] = int(np.clip(seconds / rounds / (time.perf_counter() - start), 1, 3000))
    for _ in range(rounds):
        for name, call in contestants.items():
            if pause:
                time.sleep(_PAUSE)
            for _ in range(chunk[name]):
                start = time.perf_counter()
                call()
                taken[name].append(time.perf_counter() - start)
    return {name: Times.of(seconds) for name, seconds in taken.items()}


def table(rows: Sequence[Row]) -> str:
    """Rows as a text table."""
    import pandas as pd

    frame = pd.DataFrame([row.as_dict() for row in rows])
    for name in ("ours_s", "p99_s", "yardstick_s"):
        frame[name] = frame[name].map(duration)
    frame["ratio"] = frame["ratio"].map("{:.3g}".format)
    frame["limit"] = ["" if row.limit is None else f"{row.limit:.2f}" for row in rows]
    frame["holds"] = frame["holds"].map({True: "holds", False: "MISSED"}).fillna("")
    frame.columns = frame.columns.str.removesuffix("_s")
    return frame.to_string(index=False)
