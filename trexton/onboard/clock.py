"""Stamps that only ever increase, whatever the clocks do."""

from __future__ import annotations

import time
from collections.abc import Callable

from trexton.onboard.tally import Tally

__all__ = ["StampKeeper"]

TOLERANCE = 0.5  # seconds
OLDEST = 60.0  # seconds: an older stamp is of another clock, a younger one of an old frame
SMALLEST = 1e-3


class StampKeeper:
    """Checks capture stamps of a live source, and watches the calendar clock beside the steady one.

    Parameters
    ----------
    tally : Tally
    steady, calendar : callable
        Clocks in seconds: the one that stamps are made with, and the one that people set.
    """

    def __init__(
        self,
        tally: Tally,
        steady: Callable[[], float] = time.monotonic,
        calendar: Callable[[], float] = time.time,
    ):
        self._tally, self._steady, self._calendar = tally, steady, calendar
        self._last: float | None = None
        self._shift = 0.0
        self._offset = calendar() - steady()

    def keep(self, stamp: float) -> float:
        """`stamp`, or the nearest believable one: after the last, not in the future. A frame that
        is merely old keeps its stamp."""
        now = self._steady()
        offset = self._calendar() - now
        if abs(offset - self._offset) > TOLERANCE:  # stamps are not of this clock: only said
            self._tally.fault("clock")
            self._offset = offset
        believed = stamp if now - OLDEST <= stamp <= now + TOLERANCE else now
        kept = believed + self._shift
        if self._last is not None and kept <= self._last:  # back in time: go on from where it was
            self._shift += self._last + SMALLEST - kept
            kept = self._last + SMALLEST
            self._tally.fault("clock")
        elif believed != stamp:
            self._tally.fault("clock")
        self._last = kept
        return kept
