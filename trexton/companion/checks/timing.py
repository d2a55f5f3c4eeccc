"""Timing: calls in turn, round after round, in one process, so that ratios of their times hold.

Offers `interleave`, `Contest`, whose `row` says how a stage compares, a `table` of rows, and the
`Scene` that stages are timed on.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.streams import stream
from trexton.companion.executor import limited_threads
from trexton.companion.experiments.evaluation import evenly_spread
from trexton.flights.flight import Flight
from trexton.localization.texton_map import TextonMap
from trexton.localization.training import train_map

Row = dict[str, Any]
VIEWS = 48  # frames that are looked at, evenly over the flight
_LONG = 5.0  # times what all calls should take
_PAUSE = 0.05  # seconds; threads of a BLAS spin for about as long after their last product


def interleave(
    *calls: Callable[[], object], seconds: float = 1.0, rounds: int = 9
) -> list[np.ndarray]:
    """Seconds of each repeat, in turn, so that whatever else the machine does falls on all alike.

    Each is called twice to warm up, once where that takes long, then for about `seconds` in at
    least so many `rounds`. Of a single round a call that takes long is all there is.
    """
    repeats, taken = [], [list[float]() for _ in calls]
    for call, own in zip(calls, taken, strict=True):
        for _ in range(2):
            start = time.perf_counter()
            call()
            if (once := time.perf_counter() - start) > _LONG * seconds:
                break
        if rounds == 1 and once > _LONG * seconds:
            own.append(once)
        repeats.append(0 if own else int(np.clip(seconds / rounds / once, 1, 3000)))
    for _ in range(rounds):
        for call, count, own in zip(calls, repeats, taken, strict=True):
            time.sleep(_PAUSE)
            for _ in range(count):
                start = time.perf_counter()
                call()
                own.append(time.perf_counter() - start)
    return [np.array(own) for own in taken]


@dataclass(frozen=True)
class Contest:
    """One stage beside one yardstick of the same run."""

    stage: str
    size: object
    ours: Callable[[], object]
    yardstick: str
    theirs: Callable[[], object]
    limit: float | None = None  # what the ratio of ours to theirs must not exceed
    threads: int = 1
    share: float = 1.0  # of the yardstick's time that counts, where it does other work
    rounds: int = 9

    def row(self, quick: bool = False) -> Row:
        """Medians in seconds and their ratio; ``holds`` says whether it is within the limit."""
        seconds, rounds = (0.3, min(3, self.rounds)) if quick else (1.0, self.rounds)
        with limited_threads(self.threads):
            ours, theirs = interleave(self.ours, self.theirs, seconds=seconds, rounds=rounds)
        ours_s, yardstick_s = float(np.median(ours)), self.share * float(np.median(theirs))
        ratio = ours_s / yardstick_s
        return {
            "stage": self.stage,
            "size": str(self.size),
            "threads": self.threads,
            "ours_s": ours_s,
            "p99_s": float(np.percentile(ours, 99)),
            "yardstick": self.yardstick,
            "yardstick_s": yardstick_s,
            "ratio": ratio,
            "limit": self.limit,
            "holds": None if self.limit is None else ratio <= self.limit,
        }


def table(rows: Sequence[Row]) -> str:
    """Rows as a text table."""
    import pandas as pd
    from matplotlib.ticker import EngFormatter

    frame = pd.DataFrame(rows)
    frame["holds"] = frame["holds"].map({True: "holds", False: "MISSED"})
    seconds = dict.fromkeys(("ours_s", "p99_s", "yardstick_s"), EngFormatter("s", places=1))
    return frame.to_string(index=False, na_rep="", float_format="{:.3g}".format, formatters=seconds)


class Scene:
    """A survey of the painted hall in `folder` and all that a stage may ask for, made when asked
    for.
    """

    def __init__(self, folder: Path, frames: int = 800, seed: int = 1):
        self.folder, self.frames, self.seed = folder, frames, seed
        self.map = cache(self.train)  # by method

    @cached_property
    def flight(self) -> Flight:
        from trexton.simulator.recording import record_flight

        return record_flight(self.folder / "flight", frames=self.frames, seed=self.seed)

    def contest(
        self, stage: str, ours: Callable[[], object], limit: float, frames: int = 0, **how: int
    ) -> Contest:
        """What works on all of so many frames (its flight's), beside decoding the flight once."""
        image, rows = self.flight.image, range(self.frames)
        size = f"{frames or len(self.flight)} frames"
        return Contest(
            stage, size, ours, "decoding the images", lambda: list(map(image, rows)), limit, **how
        )

    @cached_property
    def views(self) -> list[np.ndarray]:
        """``(480, 640, 3)`` frames."""
        return [self.flight.image(row) for row in evenly_spread(len(self.flight), VIEWS)]

    def train(self, method: str) -> TextonMap:
        return train_map(self.flight, method=method, rng=stream(self.seed, "training"))
