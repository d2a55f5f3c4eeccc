"""What the latest frames say together of where the vehicle is, cell by cell: places that look alike
in a frame seldom do so along a path.

Frames that follow each other err alike, so each counts as a small part of one (power likelihood),
and all are forgotten in time. The sum moves with the vehicle.
"""

import numpy as np

from trexton.field.field import Field
from trexton.field.likelihood import bilinear

MEMORY_S = 6.0  # time constant of forgetting
POWER, APART_S = 0.06, 0.08  # of the likelihood of a frame, at least so long after the last
LEAST_WEIGHT = 1e-9  # of a place, or among those that share one
RANGE = 20.0  # log likelihoods this far below the best count as this


class RecentFrames:
    """A log posterior over the cells of a `Field`, of the latest frames."""

    def __init__(self, field: Field):
        self._field = field
        self.reset()

    def reset(self) -> None:
        """Forget all."""
        self._beyond = np.zeros(2)
        self._set(np.zeros(len(self._field.centers)))

    def _set(self, log: np.ndarray) -> None:
        self._log, shares = log, np.exp(log)
        self.shares: np.ndarray = shares / shares.sum()  # (M,) probabilities of the cells

    def move(self, metres: np.ndarray) -> None:
        """The vehicle moved so many ``(2,)`` metres: by whole cells, the rest is kept."""
        field, self._beyond = self._field, self._beyond + metres
        whole = np.round(self._beyond / field.cell) * field.cell
        if whole.any():
            self._beyond = self._beyond - whole
            log = self._log.reshape(field.shape)
            self._set(bilinear(log, field.area, field.centers - whole))

    def add(self, log_posterior: np.ndarray, seconds: float) -> None:
        """One more frame, by its ``(M,)`` log posterior, so many seconds after the one before."""
        power = POWER * min(1.0, seconds / APART_S)
        total = np.exp(-seconds / MEMORY_S) * self._log + power * log_posterior
        self._set(np.maximum(total - total.max(), -RANGE))

    def near(self, places: np.ndarray, radius: float) -> np.ndarray:
        """``(T,)`` probabilities that the vehicle is within so many metres of ``(T, 2)`` places."""
        apart = self._field.centers - places[:, None]
        return (np.hypot(apart[..., 0], apart[..., 1]) < radius) @ self.shares

    def weighed(self, log_weights: np.ndarray, places: np.ndarray, radius: float) -> np.ndarray:
        """``(T,)`` log weights of hypotheses at ``(T, 2)`` places: of each place what the latest
        frames give it, of those that share it, within so many metres, by their weights.
        """
        apart, weights = places[:, None] - places, np.exp(log_weights - log_weights.max())
        near = np.hypot(apart[..., 0], apart[..., 1]) < radius
        shared = np.maximum(self.near(places, radius), LEAST_WEIGHT)
        return np.log(shared * np.maximum(weights / (near @ weights), LEAST_WEIGHT))
