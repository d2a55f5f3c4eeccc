"""Nearly constant velocity (Bar-Shalom, Li and Kirubarajan, "Estimation with Applications to
Tracking and Navigation", 2001, Sec. 6.2.2): white accelerations, fitted to the training flight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from trexton.base.options import option
from trexton.field.linear_motion import LinearMotion, flight_statistics
from trexton.localization.base import learned
from trexton.localization.training_set import Training

__all__ = ["ConstantVelocity"]


@dataclass(eq=False)
class ConstantVelocity(LinearMotion):
    """Position and velocity along each axis; the acceleration is white noise.

    States are ``(M, 4)``: x, y, their velocities.
    """

    agility: float = option(2.0, "accelerations are taken so many times as large as flown", above=0)
    intensity: np.ndarray = learned()  # () power spectral density of the acceleration, m^2/s^3

    def fit(self, training: Training) -> Self:
        speed, acceleration, time_constant = flight_statistics(training.positions, training.time)
        # White noise that moves velocities as far, in the long run, as accelerations that last.
        intensity = 2 * (self.agility * acceleration) ** 2 * time_constant
        return self.with_learned(
            speed=np.asarray(speed),
            intensity=np.asarray(intensity),
            period_s=np.asarray(training.period_s),
        )

    def over(self, dt: float) -> tuple[np.ndarray, np.ndarray]:
        transition = np.array([[1, dt], [0, 1]])
        noise = float(self.intensity) * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
        return np.kron(transition, np.eye(2)), np.kron(noise, np.eye(2))

    @property
    def prior_variance(self) -> np.ndarray:
        return np.array([0, 0, 1, 1]) * float(self.speed) ** 2
