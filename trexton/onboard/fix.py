"""What the loop hands to every sink: one position, and how far it may be trusted. Its places are in
the local frames of autopilots (north, east, down; or east, north, up)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from trexton.localization.estimate import Estimate, Measurement

STALE_AFTER = 0.5  # seconds since the capture of the latest frame that could be used

# Squared Mahalanobis distance, two dimensions: one honest pair of reports in 3000 is farther apart.
JUMP_MAHALANOBIS_SQUARED = 16.0
# Seconds that a hypothesis must last before it is sent: the first; one near the last that was sent,
# after the vehicle was lost. Another one must last until errors are independent, and as the first.
FIRST_S, RETURN_S = 1.0, 0.6
GAP_S = 0.3  # seconds of being lost after which it is no more the same hypothesis for certain


@dataclass(frozen=True, eq=False, slots=True)
class Fix:
    """A position report.

    Attributes
    ----------
    time : float
        Seconds at which the frame was captured, on the source's clock.
    number : int
        Of the frame: as the flight numbers it, or counted from 0.
    position : (2,) array
        Metres, in the map's axes.
    spread : (2,) array
        Standard deviations in x and y, metres; of a particle filter its particles' (the paper's
        uncertainty).
    covariance : (2, 2) array
        Of the error of `position`, square metres.
    lost : bool
        The localizer does not trust its position, its 90 % region would cover half of the area, or
        another hypothesis has not lasted long enough.
    observed : bool
        An image went into this report; otherwise the filter only predicted.
    stale : bool
        No image has gone in for too long.
    resets : int
        Times the position has jumped farther than its uncertainty allows.
    latency : float
        Seconds from capture to this report.
    fault : str or None
        Why the frame was refused, if it was.
    captured : float or None
        Seconds of the steady clock at the capture, or when a recording gave the frame; `time` where
        they are the same.
    measurement : Measurement or None
        Of the position, for an autopilot that takes each report for independent of the others.
    heading, heading_sigma : float or None
        Yaw of the nose, radians anticlockwise from the map's +y, and its standard deviation; None
        where the frame does not show it.
    """

    time: float
    number: int
    position: np.ndarray
    spread: np.ndarray
    covariance: np.ndarray
    lost: bool
    observed: bool
    stale: bool = False
    resets: int = 0
    latency: float = 0.0
    fault: str | None = None
    captured: float | None = None
    measurement: Measurement | None = None
    heading: float | None = None
    heading_sigma: float | None = None

    @classmethod
    def of(
        cls,
        estimate: Estimate,
        time: float,
        number: int,
        area: tuple[float, float, float, float],
        period_s: float,
        **more: Any,
    ) -> Fix:
        """The report that an estimate amounts to: one every `period_s`, in a map of this area."""
        return cls(
            time,
            number,
            estimate.position,
            estimate.spread,
            estimate.about_position,
            estimate.lost_in(area),
            estimate.observed,
            measurement=estimate.for_fusion(period_s),
            heading=estimate.heading,
            heading_sigma=estimate.heading_sigma,
            **more,
        )

    @property
    def fusion(self) -> Measurement:
        """What autopilots fuse: the measurement, else the filter's position and covariance."""
        return self.measurement or Measurement(self.position, self.covariance)

    def age(self, now: float) -> float:
        """Seconds from capture to `now` on the steady clock."""
        return now - (self.time if self.captured is None else self.captured)

    @property
    def finite(self) -> bool:
        """Whether every number of the report is one."""
        fusion = self.fusion
        numbers = (self.position, self.covariance, fusion.position, fusion.covariance, self.time)
        return all(np.isfinite(each).all() for each in numbers)

    @property
    def usable(self) -> bool:
        """Whether a vehicle may steer by it."""
        return self.finite and not self.lost and not self.stale


class Continuity:
    """Follows the hypothesis that is sent. Another one is held back, as *lost*, until it has
    lasted: places that look alike pass for one another for a while, and a receiver that was reset
    to a wrong place believes it.

    Counts the resets that it lets through, what MAVLink calls `reset_counter`. Being lost for a
    while and found again where the motion model expects it is none: a reset makes the autopilot
    drop what it knows.

    Parameters
    ----------
    growth : callable
        Gives the ``(2, 2)`` covariance in square metres that so many seconds of motion add.
    period_s : float
        Seconds from fix to fix.
    """

    def __init__(self, growth: Callable[[float], np.ndarray], period_s: float):
        self._growth, self._gap_s, self._period_s = growth, max(GAP_S, 3 * period_s), period_s
        self._last: Fix | None = None  # of the hypothesis that is sent
        self._other: Fix | None = None  # the latest of one that is held back
        self._since = self._needed = 0.0  # when that one began, and seconds that it must last
        self._interrupted = False  # the vehicle was lost since `_last`
        self.resets = 0

    def mark(self, fix: Fix) -> Fix:
        """The fix with its `resets`, held back where it must be; only usable fixes that an image
        went into are compared."""
        held = False
        if fix.usable and fix.observed:
            held = self._held_back(fix)
        else:
            self._interrupted |= fix.lost
        return replace(fix, lost=fix.lost or held, resets=self.resets)

    def _held_back(self, fix: Fix) -> bool:
        """Whether it is of another hypothesis than was sent, which has not lasted yet."""
        last, other = self._last, self._other
        jumped = last is not None and self._jumped(fix, last)
        waited = last is None or (self._interrupted and fix.time - last.time > self._gap_s)
        if jumped or waited:
            new = other is None or fix.time - other.time > self._gap_s or self._jumped(fix, other)
            if new:  # a frame stands for the time since the one before it
                self._since, self._needed = fix.time - self._period_s, RETURN_S
                if last is None:
                    self._needed = FIRST_S
                elif jumped:
                    self._needed = max(FIRST_S, fix.fusion.independent_s)
            self._other = fix
            if new or fix.time - self._since < self._needed - 1e-6:
                return True
            self.resets += jumped
        self._last, self._other, self._interrupted = fix, None, False
        return False

    def _jumped(self, fix: Fix, last: Fix) -> bool:
        allowed = fix.covariance + last.covariance + self._growth(max(fix.time - last.time, 0.0))
        step = fix.position - last.position
        return bool(step @ np.linalg.pinv(allowed) @ step > JUMP_MAHALANOBIS_SQUARED)


@dataclass(frozen=True)
class LocalFrame:
    """How the map lies on the ground; its origin is the local origin.

    Attributes
    ----------
    heading : float
        Radians from north, clockwise, of the map's +y axis (as a compass shows it when looking
        along it).
    height : float
        Metres the camera flies above the floor, sent as it is given: no estimate of it is sent.
    """

    heading: float = 0.0
    height: float = 1.0

    @property
    def ned_from_map(self) -> np.ndarray:
        """``(2, 2)`` matrix from map x, y to north, east."""
        sine, cosine = np.sin(self.heading), np.cos(self.heading)
        return np.array([[-sine, cosine], [cosine, sine]])

    def ned(self, position: np.ndarray) -> np.ndarray:
        """``(3,)`` north, east, down in metres of a ``(2,)`` map position."""
        return np.append(self.ned_from_map @ position, -self.height)

    def ned_covariance(self, covariance: np.ndarray) -> np.ndarray:
        """``(2, 2)`` covariance of north and east from that of map x and y."""
        return self.ned_from_map @ covariance @ self.ned_from_map.T

    def yaw(self, heading: float) -> float:
        """Radians from north, clockwise, within a half turn, of a heading counted anticlockwise
        from the map's +y."""
        return float(np.arctan2(np.sin(self.heading - heading), np.cos(self.heading - heading)))

    def enu(self, position: np.ndarray) -> np.ndarray:
        """``(3,)`` east, north, up in metres of a ``(2,)`` map position."""
        north, east, down = self.ned(position)
        return np.array([east, north, -down])


def decoupled(covariance: np.ndarray) -> np.ndarray:
    """The ``(2, 2)`` covariance with its correlation added to both variances.

    Autopilots fuse the diagonal alone. Taken alone, the diagonal of a correlated cloud claims too
    much across its long axis; this diagonal is at least the covariance in every direction, and so
    is the matrix with its correlation kept.
    """
    return covariance + abs(covariance[0, 1]) * np.eye(2)


def largest_deviation(covariance: np.ndarray) -> float:
    """The larger standard deviation of a `decoupled` covariance, for one number of accuracy."""
    return float(np.sqrt(np.diagonal(decoupled(covariance)).max()))
