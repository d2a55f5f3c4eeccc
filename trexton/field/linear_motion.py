"""Motion with Gaussian process noise, as a Kalman filter predicts it: the interface between method
``field`` and its motion model, and the one it flies with, Singer's.

A model of one's own is one file: a subclass of `LinearMotion` that learns in `fit` and says in
`over` how a state goes on. One that is not linear, such as a coordinated turn, overrides `moved`
and `jacobian` as well: the filter is then an extended Kalman filter.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from trexton.base.errors import ParameterError
from trexton.base.options import option
from trexton.localization.base import Area, learned
from trexton.localization.motion import MotionModel, uniform_places
from trexton.localization.training_set import Training

REACH = 2  # frames before and after, that give a velocity and an acceleration


@dataclass(eq=False)
class LinearMotion(MotionModel):
    """x' = F x + w, w ~ N(0, Q): the state one frame later.

    States are ``(M, D)``: x, y, their velocities, and whatever else the model needs.

    Attributes
    ----------
    speed : () array
        Root mean square velocity along an axis, m/s.
    period_s : () array, from frame to frame
    transition, noise : (D, D) array
        F and Q of one frame.
    """

    speed: np.ndarray = learned()
    period_s: np.ndarray = learned()

    def over(self, dt: float) -> tuple[np.ndarray, np.ndarray]:
        """``(D, D)`` transition and process noise over `dt` seconds."""
        raise NotImplementedError

    @property
    def prior_variance(self) -> np.ndarray:
        """``(D,)`` variances of a state of which only the position is known, 0 for that."""
        raise NotImplementedError

    def moved(self, states: np.ndarray) -> np.ndarray:
        """``(M, D)`` the states expected one frame later."""
        return states @ self.transition.T

    def jacobian(self, states: np.ndarray) -> np.ndarray:
        """The derivative of `moved` by the states: ``(D, D)``, or ``(M, D, D)`` of a model that is
        not linear.
        """
        return self.transition

    def prepare(self) -> None:
        for name, value in self.arrays().items():
            if not (value.shape == () and 0 < value < np.inf):
                raise ParameterError(f"the motion's {name} is {value}: expected a positive number")
        self.transition, self.noise = self.over(float(self.period_s))
        self._color = np.linalg.cholesky(self.noise + 1e-12 * np.eye(len(self.noise)))
        self._whiten = np.linalg.inv(self._color)

    def start(self, rng: np.random.Generator, area: Area, count: int) -> np.ndarray:
        deviation = np.sqrt(self.prior_variance)
        states: np.ndarray = rng.standard_normal((count, len(deviation))) * deviation
        states[:, :2] = uniform_places(rng, area, count)
        return states

    def sample(self, states: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return self.moved(states) + rng.standard_normal(states.shape) @ self._color.T

    def density(self, states: np.ndarray, previous: np.ndarray, weights: np.ndarray) -> np.ndarray:
        white, expected = states @ self._whiten.T, self.moved(previous) @ self._whiten.T
        squared = np.square(white[:, None] - expected).sum(axis=2)
        nearest = squared.min(axis=1)
        shares = np.exp(-0.5 * (squared - nearest[:, None])) @ weights
        return np.log(np.maximum(shares, np.finfo(float).tiny)) - 0.5 * nearest

    def position(self, states: np.ndarray) -> np.ndarray:
        return states[:, :2]

    def growth(self, dt: float) -> np.ndarray:
        transition, noise = self.over(dt)
        return (transition[:2] * self.prior_variance) @ transition[:2].T + noise[:2, :2]


@dataclass(eq=False)
class Singer(LinearMotion):
    """Position, velocity and acceleration along each axis; the acceleration is a first-order
    Gauss-Markov process (Singer, "Estimating optimal filter tracking performance for manned
    maneuvering targets", IEEE Trans. AES-6, 1970), fitted to the training flight.

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


def flight_statistics(positions: np.ndarray, time: np.ndarray) -> tuple[float, float, float]:
    """Standard deviations of velocity and acceleration along an axis (m/s, m/s^2), and the
    acceleration's correlation time in seconds, of a flight's ``(N, 2)`` positions in metres.
    """
    period = float(np.median(np.diff(time)))
    middle = np.arange(REACH, len(time) - REACH)
    span = time[middle + REACH] - time[middle - REACH]
    middle = middle[span <= 1.5 * 2 * REACH * period]
    if len(middle) <= 2 * REACH:
        reach = float(np.hypot(*np.diff(positions, axis=0).T).mean()) + 1e-6
        return reach / period, reach / period**2, period
    before, here, after = (positions[middle + offset] for offset in (-REACH, 0, REACH))
    step = REACH * period
    velocity, acceleration = (after - before) / (2 * step), (after - 2 * here + before) / step**2
    variance = float(np.square(acceleration).mean()) + 1e-12
    lag = 2 * REACH  # apart enough to share no position
    correlation = float((acceleration[lag:] * acceleration[:-lag]).mean()) / variance
    time_constant = -lag * period / np.log(np.clip(correlation, 0.05, 0.95))
    speed = max(float(np.sqrt(np.square(velocity).mean())), 1e-6)
    return speed, float(np.sqrt(variance)), float(np.clip(time_constant, 2 * period, 25 * period))
