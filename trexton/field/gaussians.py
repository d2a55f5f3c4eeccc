"""Many Gaussians at once, each told the same: the algebra of a Kalman filter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["Glimpse"]


@dataclass(frozen=True, eq=False)
class Glimpse:
    """A part of ``T`` states of ``d`` numbers, seen with noise, two numbers at a time.

    Attributes
    ----------
    expected : (T, 2) array
        What each state expects to be seen.
    spread : (T, 2, 2) array
        Covariance of what is seen about it.
    precision : (T, 2, 2) array
        Its inverse.
    """

    expected: np.ndarray
    spread: np.ndarray
    precision: np.ndarray
    _states: np.ndarray
    _covariances: np.ndarray
    _gain: np.ndarray

    @classmethod
    def of(
        cls, states: np.ndarray, covariances: np.ndarray, seen: np.ndarray, noise: np.ndarray
    ) -> Glimpse:
        """Of `states` ``(T, d)``, their `covariances` ``(T, d, d)``, through `seen` ``(2, d)``."""
        across = covariances @ seen.T
        spread = seen @ across + noise
        precision = np.linalg.inv(spread)
        return cls(states @ seen.T, spread, precision, states, covariances, across @ precision)

    def after(
        self, mean: np.ndarray, covariance: np.ndarray | float = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """States and covariances once it is known what was seen: `mean` ``(T, 2)`` or ``(2,)``, up
        to its `covariance` ``(T, 2, 2)``."""
        states = self._states + np.einsum("tij,tj->ti", self._gain, mean - self.expected)
        turned = self._gain.transpose(0, 2, 1)
        covariances = self._covariances - self._gain @ (self.spread - covariance) @ turned
        return states, (covariances + covariances.transpose(0, 2, 1)) / 2
