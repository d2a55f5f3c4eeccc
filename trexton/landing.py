"""Land where the position says so: zone and trigger (paper, Analysis, "Triggered Landing")."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from trexton.errors import ParameterError
from trexton.estimate import Estimate

__all__ = ["LandingZone"]


class LandingZone:
    """A circle, and the trigger that fires when the vehicle is believed to be in it, surely enough.

    Parameters
    ----------
    center : (2,) array
        Metres.
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
        self,
        center: ArrayLike,
        radius: float = 0.6,
        spread: ArrayLike = 0.6,
        consecutive: int = 1,
    ):
        self.center = np.array(center, dtype=float)
        self.radius = float(radius)
        self.spread = (
            np.broadcast_to(np.asarray(spread, dtype=float), 2).copy()
            if np.size(spread) in (1, 2)
            else np.full(2, np.nan)
        )
        self.consecutive = consecutive
        if self.center.shape != (2,) or not np.isfinite(self.center).all():
            raise ParameterError(
                f"the landing zone's centre is {center!r}: expected finite x and y in metres"
            )
        if not (
            0 < self.radius < np.inf and (self.spread > 0).all() and np.isfinite(self.spread).all()
        ):
            raise ParameterError(
                f"the landing zone has radius {radius} m and spread {spread!r} m: "
                "expected positive numbers"
            )
        if consecutive < 1:
            raise ParameterError(
                f"{consecutive} consecutive estimates were asked for: expected at least 1"
            )
        self._row = 0

    def contains(self, position: np.ndarray) -> bool:
        """Whether the ``(2,)`` position lies within the circle."""
        return bool(np.hypot(*(np.asarray(position) - self.center)) < self.radius)

    def accepts(self, estimate: Estimate) -> bool:
        """Whether this estimate alone permits a landing: inside, sure, not lost, from a frame that
        came.
        """
        sure = bool((np.asarray(estimate.spread) < self.spread).all())
        return self.contains(estimate.position) and sure and estimate.observed and not estimate.lost

    def update(self, estimate: Estimate) -> bool:
        """Take the next `trexton.estimate.Estimate`; True once enough in a row permit a landing."""
        self._row = self._row + 1 if self.accepts(estimate) else 0
        return self._row >= self.consecutive

    def reset(self) -> None:
        """Forget the estimates so far."""
        self._row = 0
