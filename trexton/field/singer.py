"""A vehicle that accelerates: Singer's model ("Estimating optimal filter tracking performance
for manned maneuvering targets", IEEE Trans. AES-6, 1970), fitted to the training flight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from trexton.base.errors import ParameterError
from trexton.localization.base import Area, Training, learned
from trexton.localization.motion import MotionModel, uniform_places

__all__ = ["Singer"]

REACH = 2  # frames before and after, that give a velocity and an acceleration


@dataclass(eq=False)
class Singer(MotionModel):
    """Position, velocity and acceleration along each axis; the acceleration forgets itself in time.

    States are ``(M, 6)``: x, y, their velocities, their accelerations.

    Parameters
    ----------
    agility : float
        Accelerations are taken so many times as large as flown. Vehicles hover and dash: with
        more than 1 a filter follows the dashes, and claims less of the velocity than it knows.
    """

    agility: float = 2.0
    speed: np.ndarray = learned()  # () standard deviation of the velocity along an axis, m/s
    acceleration: np.ndarray = learned()  # () the same of the acceleration, m/s^2
    lasts_s: np.ndarray = learned()  # () time after which an acceleration is down to 1/e
    period_s: np.ndarray = learned()

    def check(self) -> None:
        if not 0 < self.agility < np.inf:
            raise ParameterError(f"agility is {self.agility}: expected a positive number")

    def fit(self, training: Training) -> Self:
        speed, acceleration, lasts_s = _moments(training.positions, training.time)
        return self.with_learned(
            speed=np.asarray(speed),
            acceleration=np.asarray(self.agility * acceleration),
            lasts_s=np.asarray(lasts_s),
            period_s=np.asarray(training.period_s),
        )

    def prepare(self) -> None:
        for name, value in self.arrays().items():
            if not (value.shape == () and 0 < value < np.inf):
                raise ParameterError(f"the motion's {name} is {value}: expected a positive number")
        transition, noise = self.over(float(self.period_s))
        self.transition = np.kron(transition, np.eye(2))
        self.noise = np.kron(noise, np.eye(2))
        self._color = np.linalg.cholesky(self.noise + 1e-12 * np.eye(6))
        self._whiten = np.linalg.inv(self._color)

    def over(self, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """``(3, 3)`` transition and noise covariance of one axis over `dt` seconds."""

        def response(seconds: np.ndarray) -> np.ndarray:
            """``(3, n)`` state after `seconds` of an acceleration of 1 that decays."""
            ratio = seconds / tau
            decayed = np.exp(-ratio)
            return np.array([tau**2 * (decayed - 1 + ratio), tau * (1 - decayed), decayed])

        tau = float(self.lasts_s)
        transition = np.array([[1, dt, 0], [0, 1, 0], [0, 0, 0.0]])
        transition[:, 2] = response(np.array([dt]))[:, 0]
        middles = (np.arange(32) + 0.5) / 32 * dt  # the integral over the noise's age, by midpoints
        kicked = response(middles)
        strength = 2 * float(self.acceleration) ** 2 / tau
        return transition, (kicked @ kicked.T) * (dt / 32 * strength)

    @property
    def rest(self) -> np.ndarray:
        """``(6,)`` variances of a state of which only the position is known."""
        speed, acceleration = float(self.speed) ** 2, float(self.acceleration) ** 2
        rest: np.ndarray = np.array([0, 0, speed, speed, acceleration, acceleration])
        return rest

    def start(self, rng: np.random.Generator, area: Area, count: int) -> np.ndarray:
        states: np.ndarray = rng.standard_normal((count, 6)) * np.sqrt(self.rest)
        states[:, :2] = uniform_places(rng, area, count)
        return states

    def sample(self, states: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        moved: np.ndarray = states @ self.transition.T
        moved += rng.standard_normal(states.shape) @ self._color.T
        return moved

    def density(self, states: np.ndarray, previous: np.ndarray, weights: np.ndarray) -> np.ndarray:
        white = states @ self._whiten.T
        expected = previous @ (self._whiten @ self.transition).T
        squared = np.square(white[:, None] - expected).sum(axis=2)
        near = squared.min(axis=1)
        shares = np.exp(-0.5 * (squared - near[:, None])) @ weights
        found: np.ndarray = np.log(np.maximum(shares, np.finfo(float).tiny)) - 0.5 * near
        return found

    def position(self, states: np.ndarray) -> np.ndarray:
        return states[:, :2]

    def growth(self, dt: float) -> np.ndarray:
        transition, noise = self.over(dt)
        rest = self.rest[::2]
        return np.eye(2) * float(transition[0] @ (rest * transition[0]) + noise[0, 0])


def _moments(positions: np.ndarray, time: np.ndarray) -> tuple[float, float, float]:
    """Deviations of velocity and acceleration along an axis, and how long the latter lasts."""
    period = float(np.median(np.diff(time)))
    middle = np.arange(REACH, len(time) - REACH)
    span = time[middle + REACH] - time[middle - REACH]
    middle = middle[span <= 1.5 * 2 * REACH * period]
    if len(middle) < 2 * REACH:
        reach = float(np.hypot(*np.diff(positions, axis=0).T).mean()) + 1e-6
        return reach / period, reach / period**2, period
    before, here, after = (positions[middle + offset] for offset in (-REACH, 0, REACH))
    step = REACH * period
    velocity, acceleration = (after - before) / (2 * step), (after - 2 * here + before) / step**2
    variance = float(np.square(acceleration).mean()) + 1e-12
    lag = 2 * REACH  # apart enough to share no position
    alike = float((acceleration[lag:] * acceleration[:-lag]).mean()) / variance
    lasts = -lag * period / np.log(np.clip(alike, 0.05, 0.95))
    speed = max(float(np.sqrt(np.square(velocity).mean())), 1e-6)
    return speed, float(np.sqrt(variance)), float(np.clip(lasts, 2 * period, 25 * period))
