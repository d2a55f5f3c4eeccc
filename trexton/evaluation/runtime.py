"""Processing time of a frame, measured in the stages of the localizer themselves. Offers
`StageTimer`, and medians with intervals as records hold them, in milliseconds or as a rate."""

from __future__ import annotations

from collections.abc import Sequence
from time import perf_counter
from typing import Any

import numpy as np

from trexton.localization.estimate import Estimate
from trexton.localization.localizer import Localizer, TextonMap

__all__ = ["STAGES", "StageTimer", "frequency", "milliseconds", "of_frames"]

STAGES = ("histogram", "neighbors", "filter", "estimate")


class StageTimer:
    """A localizer whose stages are timed one by one, in the order in which `step` runs them.

    Parameters
    ----------
    texton_map : TextonMap
    **options
        Of the localizer.

    Attributes
    ----------
    seconds : dict of str to list of float
        ``histogram`` (empty where frames are histograms), ``neighbors``, ``filter``, ``estimate``:
        one entry a frame.
    """

    def __init__(self, texton_map: TextonMap, **options: Any) -> None:
        self.localizer = Localizer(texton_map, mark=self._mark, **options)
        self.seconds: dict[str, list[float]] = {name: [] for name in STAGES}
        self._last = 0.0

    def _mark(self, stage: str) -> None:
        now = perf_counter()
        self.seconds[stage].append(now - self._last)
        self._last = now

    def step(self, frame: np.ndarray) -> Estimate:
        """One frame, an image or a histogram."""
        self._last = perf_counter()
        return self.localizer.step(frame)

    def medians(self) -> dict[str, float]:
        """Median seconds of each stage that ran."""
        return {name: float(np.median(taken)) for name, taken in self.seconds.items() if taken}


def milliseconds(runs: Sequence[np.ndarray], stretch: int = 20) -> dict[str, Any]:
    """``median``, ``low``, ``high`` in ms of times in seconds.

    Single frames now and then wait for the rest of the machine; the interval is that of medians
    over `stretch` frames, which do not feel that.
    """
    pieces = [piece for run in runs for piece in np.array_split(run, max(1, len(run) // stretch))]
    low, high = np.percentile([np.median(piece) for piece in pieces], (2.5, 97.5))
    median = np.median(np.concatenate(runs))
    times = {"median": median, "low": min(low, median), "high": max(high, median)}
    return {name: 1000 * seconds for name, seconds in times.items()}


def of_frames(seconds: np.ndarray, unit: str = "") -> dict[str, Any]:
    """``median`` and ``p99`` of the seconds that single frames took; names may end in a unit."""
    return {f"median{unit}": np.median(seconds), f"p99{unit}": np.percentile(seconds, 99)}


def frequency(time_ms: dict[str, Any]) -> dict[str, Any]:
    """The same as a rate in Hz."""
    times = {"median": "median", "low": "high", "high": "low"}
    return {name: 1000 / time_ms[time] for name, time in times.items()}
