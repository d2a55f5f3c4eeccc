"""Timing: contestants in turn, round after round, in one process; and the rows that come of it."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, TypeVar

import numpy as np

from trexton.companion.wording import duration

__all__ = ["Row", "Times", "interleave", "table"]

K = TypeVar("K", str, int)
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
    ours_s, yardstick_s : float
        Medians in seconds.
    yardstick : str
    ratio : float
        Ours over the yardstick.
    limit : float or None
        What the ratio must not exceed.
    p99_s : float or None
        99th percentile of ours.
    note : str
    """

    stage: str
    size: str
    threads: int
    ours_s: float
    yardstick: str
    yardstick_s: float
    ratio: float
    limit: float | None = None
    p99_s: float | None = None
    note: str = ""

    @classmethod
    def compare(
        cls,
        stage: str,
        size: object,
        threads: int,
        ours: Times,
        yardstick: str,
        theirs: Times | float,
        limit: float | None = None,
        note: str = "",
    ) -> Row:
        """A row from times; a yardstick may be a plain number of seconds of the same run."""
        seconds = float(theirs.median if isinstance(theirs, Times) else theirs)
        ratio = ours.median / seconds
        return cls(
            stage, str(size), threads, ours.median, yardstick, seconds, ratio, limit, ours.p99, note
        )

    @property
    def holds(self) -> bool | None:
        """Whether the limit holds; None where there is none."""
        return None if self.limit is None else self.ratio <= self.limit

    def as_dict(self) -> dict[str, Any]:
        return asdict(self) | {"holds": self.holds}


def interleave(
    contestants: Mapping[K, Callable[[], object]],
    seconds: float = 1.0,
    rounds: int = 9,
    pause: bool = False,
) -> dict[K, Times]:
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
    chunk: dict[K, int] = {}
    taken: dict[K, list[float]] = {name: [] for name in contestants}
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


def table(rows: list[Row]) -> str:
    """Rows as a text table."""
    import pandas as pd

    verdicts = {True: "holds", False: "MISSED", None: ""}
    cells = [
        {
            "stage": row.stage,
            "size": row.size,
            "threads": row.threads,
            "ours": duration(row.ours_s),
            "p99": "" if row.p99_s is None else duration(row.p99_s),
            "yardstick": row.yardstick,
            "takes": duration(row.yardstick_s),
            "ratio": f"{row.ratio:.3g}",
            "at most": "" if row.limit is None else f"{row.limit:.2f}",
            "": verdicts[row.holds],
            "note": row.note,
        }
        for row in rows
    ]
    return pd.DataFrame(cells).to_string(index=False)
