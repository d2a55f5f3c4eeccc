"""Timing: contestants in turn, round after round, in one process; and the rows that come of it.

Offers `interleave`, and `row`, a stage beside a yardstick of the same run.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from trexton.companion.wording import duration

__all__ = ["Row", "interleave", "row", "table"]

Row = dict[str, Any]

_PAUSE = 0.05  # seconds; threads of a BLAS spin for about as long after their last product


def row(
    stage: str,
    size: object,
    threads: int,
    ours: np.ndarray | list[float] | float,
    yardstick: str,
    theirs: np.ndarray | list[float] | float,
    limit: float | None = None,
    note: str = "",
) -> Row:
    """One stage beside one yardstick of the same run.

    Parameters
    ----------
    ours, theirs : array or float
        Seconds of each repeat; medians are compared.
    limit : float or None
        What their ratio must not exceed; ``holds`` says whether it does.
    """
    ours_s, theirs_s = float(np.median(ours)), float(np.median(theirs))
    ratio = ours_s / theirs_s
    return {
        "stage": stage, "size": str(size), "threads": threads, "ours_s": ours_s,
        "p99_s": float(np.percentile(ours, 99)), "yardstick": yardstick, "yardstick_s": theirs_s,
        "ratio": ratio, "limit": limit, "holds": None if limit is None else ratio <= limit,
        "note": note,
    }  # fmt: skip


def interleave(
    contestants: Mapping[str, Callable[[], object]],
    seconds: float = 1.0,
    rounds: int = 9,
) -> dict[str, np.ndarray]:
    """Seconds of each call, in turn, so that whatever else the machine does falls on all alike.

    Parameters
    ----------
    contestants : dict of str to callable
        Each is called twice to warm up.
    seconds : float
        For each of them, about.
    rounds : int
        At least so many turns, fewer calls in each.
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
            time.sleep(_PAUSE)
            for _ in range(chunk[name]):
                start = time.perf_counter()
                call()
                taken[name].append(time.perf_counter() - start)
    return {name: np.array(seconds) for name, seconds in taken.items()}


def table(rows: Sequence[Row]) -> str:
    """Rows as a text table."""
    import pandas as pd

    frame = pd.DataFrame(rows)
    frame["holds"] = frame["holds"].map({True: "holds", False: "MISSED"})
    seconds = dict.fromkeys(("ours_s", "p99_s", "yardstick_s"), duration)
    return frame.to_string(index=False, na_rep="", float_format="{:.3g}".format, formatters=seconds)
