"""Land where the position says so (paper, Analysis, "Triggered Landing"). Offers the zone with its
trigger, and one that weighs where the vehicle would touch down."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from trexton.base.errors import ParameterError
from trexton.base.options import number, whole
from trexton.localization.estimate import Estimate

GUST = 0.14  # metres: standard deviation along an axis of what is in no velocity
CONFIDENCE, LEAST = 0.9, 0.8  # chance of a touchdown inside: asked for at first, and at last
LATER_S = 0.25  # after so many seconds the chance must not be better than now
_GATE_SIGMA = 4.0  # innovation gate: an estimate beyond is a jump


class LandingZone:
    """A circle, and the trigger that fires when the vehicle is believed to be in it, surely enough.

    Parameters
    ----------
    center : (2,) array, metres
    radius : float
        r, metres.
    spread : float or (2,) array
        theta_x and theta_y, metres: the particles' standard deviations must be below them.
    consecutive : int
        Number of estimates in a row that must agree; 1 in the paper.

    Raises
    ------
    ParameterError
        A value is not finite or not positive.
    """

    def __init__(
        self, center: ArrayLike, radius: float = 0.6, spread: ArrayLike = 0.6, consecutive: int = 1
    ):
        self.center = np.array(center, dtype=float)
        if self.center.shape != (2,) or not np.isfinite(self.center).all():
            raise ParameterError(
                f"the landing zone's centre is {center!r}: expected finite x and y in metres"
            )
        self.radius = number(radius, "the landing zone's radius in metres", above=0)
        sides = np.ravel(spread).tolist()
        if len(sides) not in (1, 2):
            raise ParameterError(f"the spread is {spread!r}: expected one number, or of x and y")
        sides = [number(each, "the spread in metres", above=0) for each in sides]
        self.spread = np.resize(sides, 2)
        self.consecutive = whole(consecutive, "the number of consecutive estimates")
        self._row = 0

    def contains(self, position: np.ndarray) -> bool:
        """Whether the ``(2,)`` position lies within the circle."""
        return bool(np.hypot(*(np.asarray(position) - self.center)) < self.radius)

    def accepts(self, estimate: Estimate, elapsed_s: float = 0.0) -> bool:
        """Whether this estimate alone permits a landing: inside, sure, not lost, from a frame that
        came; here whenever that is, in seconds after the search began.
        """
        sure = bool((np.asarray(estimate.spread) < self.spread).all())
        return self.contains(estimate.position) and sure and estimate.observed and not estimate.lost

    def update(self, estimate: Estimate, elapsed_s: float = 0.0) -> bool:
        """Take the next estimate, `elapsed_s` seconds after the search began.

        Returns
        -------
        bool
            True once enough in a row permit a landing.
        """
        self._row = self._row + 1 if self.accepts(estimate, elapsed_s) else 0
        return self._row >= self.consecutive

    def reset(self) -> None:
        """Forget the estimates so far."""
        self._row = 0


class TouchdownZone(LandingZone):
    """A circle, and a trigger that fires when the vehicle would probably touch down in it.

    From the trigger to the ground a vehicle drifts on. What counts is where it will touch down: the
    estimate carried on with its velocity, and how far that may be off. The chance that it lies in
    the circle must be high at first, and may be lower as the time runs out: a late landing at the
    edge is worth more than none. And a chance that is still growing is waited for: a vehicle on its
    way to the middle would else come down at the edge. Vehicles do not jump: after an estimate that
    does, to where a floor looks alike or back from there, and after one that is lost, nothing is
    triggered for a while.

    Parameters
    ----------
    center, radius, consecutive
        As of a `LandingZone`, and so are errors.
    drift_s : float
        Seconds of the present velocity that the vehicle drifts while it brakes and comes down.
    time_limit : float
        Seconds that the search for a moment to land may take.
    settled_s : float
        Seconds for which no estimate may have been lost, or elsewhere than the one before it
        predicted.
    """

    def __init__(
        self,
        center: ArrayLike,
        radius: float = 0.6,
        *,
        drift_s: float = 0.5,
        time_limit: float = 60.0,
        settled_s: float = 1.5,
        consecutive: int = 1,
    ):
        super().__init__(center, radius, consecutive=consecutive)
        self.drift_s = number(drift_s, "the drift in seconds", low=0)
        self.time_limit = number(time_limit, "the time limit in seconds", above=0)
        self.settled_s = number(settled_s, "the time to settle in seconds", low=0)
        self._before: tuple[float, Estimate] | None = None
        self._unsettled_s = 0.0

    def chance(self, estimate: Estimate, later_s: float = 0.0) -> float:
        """Chance that a landing triggered now, or so much later, touches down in the circle."""
        place, covariance = estimate.ahead(self.drift_s + later_s)
        variances, axes = np.linalg.eigh(covariance + GUST**2 * np.eye(2))
        offset = axes.T @ (np.asarray(place) - self.center)
        return _inside(offset, np.sqrt(variances), self.radius)

    def wanted(self, elapsed_s: float) -> float:
        """Chance that is asked for after so many seconds of search."""
        share = min(max(elapsed_s / self.time_limit, 0.0), 1.0)
        return CONFIDENCE - (CONFIDENCE - LEAST) * share**2

    def accepts(self, estimate: Estimate, elapsed_s: float = 0.0) -> bool:
        """Whether this estimate alone permits a landing after so many seconds of search."""
        if not estimate.observed or estimate.lost:
            return False
        chance = self.chance(estimate)
        return chance >= self.wanted(elapsed_s) and chance >= self.chance(estimate, LATER_S)

    def update(self, estimate: Estimate, elapsed_s: float = math.nan) -> bool:
        """As of `LandingZone`, but the seconds must be given; never before estimates settled."""
        elapsed_s = number(elapsed_s, "the seconds since the search began")
        before, self._before = self._before, (elapsed_s, estimate)
        if before is None or estimate.lost or self._jumped(*before, estimate, elapsed_s):
            self._unsettled_s = elapsed_s
        wanted = super().update(estimate, elapsed_s)
        return wanted and elapsed_s - self._unsettled_s >= self.settled_s

    def reset(self) -> None:
        """Forget the estimates so far."""
        super().reset()
        self._before = None

    def _jumped(self, before_s: float, before: Estimate, estimate: Estimate, now_s: float) -> bool:
        """Whether an estimate lies beyond what is likely after the one before."""
        place, covariance = before.ahead(now_s - before_s)
        offset = estimate.position - place
        unsure = covariance + estimate.covariance + GUST**2 * np.eye(2)
        return bool(offset @ np.linalg.solve(unsure, offset) > _GATE_SIGMA**2)


def _inside(offset: np.ndarray, deviation: np.ndarray, radius: float) -> float:
    """Mass of a normal distribution within a circle whose centre is `offset` from its mean."""
    nodes, weights = np.polynomial.legendre.leggauss(24)
    x = radius * nodes
    density = np.exp(-0.5 * ((x - offset[0]) / deviation[0]) ** 2) / (deviation[0] * math.tau**0.5)
    half, scale = np.sqrt(radius**2 - x**2), deviation[1] * math.sqrt(2)
    share = [
        math.erf((edge - offset[1]) / scale) - math.erf((-edge - offset[1]) / scale)
        for edge in half
    ]
    return float(radius * (weights * density) @ share / 2)
