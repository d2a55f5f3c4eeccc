"""Times as records carry them: a median, and how far they reach."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

__all__ = ["frequency", "milliseconds", "of_frames"]

_STRETCH = 20  # measurements


def milliseconds(runs: Sequence[np.ndarray], stretch: int = _STRETCH) -> dict[str, Any]:
    """``median``, ``low``, ``high`` in ms of times in seconds.

    Single frames now and then wait for the rest of the machine; a median over a stretch does not
    feel that.
    """
    pieces = [piece for run in runs for piece in np.array_split(run, max(1, len(run) // stretch))]
    low, high = np.percentile([np.median(piece) for piece in pieces], (2.5, 97.5))
    median = np.median(np.concatenate(runs))
    return {
        "median": 1000 * median,
        "low": 1000 * min(low, median),
        "high": 1000 * max(high, median),
    }


def of_frames(seconds: np.ndarray) -> dict[str, Any]:
    """``median`` and ``p99`` of the seconds that single frames took."""
    return {"median": np.median(seconds), "p99": np.percentile(seconds, 99)}


def frequency(time_ms: dict[str, Any]) -> dict[str, Any]:
    """The same as a rate in Hz."""
    return {
        "median": 1000 / time_ms["median"],
        "low": 1000 / time_ms["high"],
        "high": 1000 / time_ms["low"],
    }
