"""The Kalman update of many Gaussian states at once by one measurement of two numbers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["MeasurementPrediction"]


@dataclass(frozen=True, eq=False)
class MeasurementPrediction:
    """What ``T`` states of ``d`` numbers predict of a measurement z = H x + v, v ~ N(0, R).

    Attributes
    ----------
    mean : (T, 2) array
        H x.
    covariance : (T, 2, 2) array
        S = H P H' + R, of the innovation.
    precision : (T, 2, 2) array
        Its inverse.
    """

    mean: np.ndarray
    covariance: np.ndarray
    precision: np.ndarray
    _states: np.ndarray
    _covariances: np.ndarray
    _gain: np.ndarray

    @classmethod
    def of(
        cls, states: np.ndarray, covariances: np.ndarray, matrix: np.ndarray, noise: np.ndarray
    ) -> MeasurementPrediction:
        """Of `states` ``(T, d)``, their `covariances` ``(T, d, d)``, H ``(2, d)`` and R."""
        across = covariances @ matrix.T
        spread = matrix @ across + noise
        precision = np.linalg.inv(spread)
        return cls(states @ matrix.T, spread, precision, states, covariances, across @ precision)

    def updated(
        self, measured: np.ndarray, covariance: np.ndarray | float = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """States and covariances given z: `measured` ``(T, 2)`` or ``(2,)``, itself known up to a
        `covariance` ``(T, 2, 2)``.
        """
        states = self._states + np.einsum("tij,tj->ti", self._gain, measured - self.mean)
        turned = self._gain.transpose(0, 2, 1)
        covariances = self._covariances - self._gain @ (self.covariance - covariance) @ turned
        return states, (covariances + covariances.transpose(0, 2, 1)) / 2
