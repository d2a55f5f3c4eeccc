"""Singer's motion model ("Estimating optimal filter tracking performance for manned maneuvering
targets", IEEE Trans. AES-6, 1970): accelerations that decay, fitted to the training flight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from trexton.base.options import option
from trexton.field.linear_motion import LinearMotion, flight_statistics
from trexton.localization.base import learned
from trexton.localization.training_set import Training

__all__ = ["Singer"]


@dataclass(eq=False)
class Singer(LinearMotion):
    """Position, velocity and acceleration along each axis; the acceleration is a first-order
    Gauss-Markov process.

    States are ``(M, 6)``: x, y, their velocities, their accelerations.

    Vehicles hover and dash: with an agility of more than 1 a filter follows the dashes, and claims
    less of the velocity than it knows.
    """

    agility: float = option(2.0, "accelerations are taken so many times as large as flown", above=0)
    acceleration: np.ndarray = learned()  # () standard deviation along an axis, m/s^2
    time_constant_s: np.ndarray = learned()  # () time constant of the acceleration, tau

    def fit(self, training: Training) -> Self:
        speed, acceleration, time_constant = flight_statistics(training.positions, training.time)
        return self.with_learned(
            speed=np.asarray(speed),
            acceleration=np.asarray(self.agility * acceleration),
            time_constant_s=np.asarray(time_constant),
            period_s=np.asarray(training.period_s),
        )

    def over(self, dt: float) -> tuple[np.ndarray, np.ndarray]:
        def response(seconds: np.ndarray) -> np.ndarray:
            """``(3, n)`` state after `seconds` of an acceleration of 1 that decays."""
            ratio = seconds / tau
            decayed = np.exp(-ratio)
            return np.array([tau**2 * (decayed - 1 + ratio), tau * (1 - decayed), decayed])

        tau = float(self.time_constant_s)
        transition = np.array([[1, dt, 0], [0, 1, 0], [0, 0, 0.0]])
        transition[:, 2] = response(np.array([dt]))[:, 0]
        middles = (np.arange(32) + 0.5) / 32 * dt  # the integral over the noise's age, by midpoints
        kicked = response(middles)
        strength = 2 * float(self.acceleration) ** 2 / tau
        noise = (kicked @ kicked.T) * (dt / 32 * strength)
        return np.kron(transition, np.eye(2)), np.kron(noise, np.eye(2))

    @property
    def prior_variance(self) -> np.ndarray:
        speed, acceleration = float(self.speed) ** 2, float(self.acceleration) ** 2
        return np.array([0, 0, speed, speed, acceleration, acceleration])
