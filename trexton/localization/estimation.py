"""A particle set becomes one position. Offers the weighted mean, the best particle and the maximum
a posteriori."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trexton.localization.base import Part
from trexton.localization.motion import MotionModel

__all__ = ["Belief", "Estimation", "HighestWeight", "MaximumAPosteriori", "WeightedMean"]


@dataclass(frozen=True, eq=False, slots=True)
class Belief:
    """A particle set after one step, before resampling.

    Attributes
    ----------
    states : (M, D) array
        Of the motion model.
    weights : (M,) array
        Summing to one.
    log_likelihood : (M,) array
        Zero where nothing was measured.
    log_mean_likelihood : float
        Of the measurement under the whole set; NaN where nothing was measured.
    lost : bool
        No particle explained the measurement, or the measurements have stopped fitting.
    """

    states: np.ndarray
    weights: np.ndarray
    log_likelihood: np.ndarray
    log_mean_likelihood: float = np.nan
    lost: bool = False

    @property
    def measured(self) -> bool:
        """Whether the weights come from a measurement."""
        return self.log_mean_likelihood == self.log_mean_likelihood


@dataclass(eq=False)
class Estimation(Part):
    """Base of all point estimates."""

    def position(self, belief: Belief, previous: Belief | None, motion: MotionModel) -> np.ndarray:
        """``(2,)`` metres, from this belief and the one before the motion."""
        raise NotImplementedError


@dataclass(eq=False)
class MaximumAPosteriori(Estimation):
    """argmax of p(z_t | x_i) sum_j p(x_i | x_j at t-1) w_j at t-1 (Driessen & Boers 2008)."""

    def position(self, belief: Belief, previous: Belief | None, motion: MotionModel) -> np.ndarray:
        if previous is None:
            row = int(np.argmax(belief.log_likelihood))
        else:
            row = motion.likeliest(
                belief.log_likelihood, belief.states, previous.states, previous.weights
            )
        return _place(belief, motion, row)


@dataclass(eq=False)
class WeightedMean(Estimation):
    """Weighted mean of the particles."""

    def position(self, belief: Belief, previous: Belief | None, motion: MotionModel) -> np.ndarray:
        return belief.weights @ motion.position(belief.states)


@dataclass(eq=False)
class HighestWeight(Estimation):
    """The particle of highest weight, the first where several share it."""

    def position(self, belief: Belief, previous: Belief | None, motion: MotionModel) -> np.ndarray:
        return _place(belief, motion, int(np.argmax(belief.weights)))


def _place(belief: Belief, motion: MotionModel, row: int) -> np.ndarray:
    return motion.position(belief.states[row : row + 1])[0]
