"""A quadrotor that follows goals with lag, in gusty air.

Velocity follows the goal, tilt the wanted acceleration, and the air pushes; heading and height
wander. The equations are integrated in small steps, so that the motion within one exposure is true.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trexton.base.options import number

STEP = 0.01  # seconds of one integration step
GRAVITY = 9.81
APPROACH = 1.2  # wanted speed for each metre of distance to the goal, 1/s
VELOCITY_LAG = 0.45  # time constant of the velocity controller, s
ACCELERATION = 1.2  # strongest wanted acceleration, m/s2, a tilt of 7 degrees
DRAG = 0.25  # 1/s
TILT_FREQUENCY, TILT_DAMPING = 12.0, 0.8  # attitude controller, rad/s and share of critical
TILT_JITTER, JITTER_TIME = 0.008, 0.15  # rad, s
GUST, GUST_TIME = 0.18, 1.0  # m/s2, s
WANDER_FREQUENCY = np.array([2.0, 0.9])  # of height and heading, rad/s
DESCENT = 0.35  # m/s
TOUCHDOWN = 0.05  # camera height on the ground, m


@dataclass(frozen=True)
class VehicleState:
    """Where the vehicle is and how it moves, so many seconds after the start: position and velocity
    ``(3,)`` in metres, z above the floor; roll, pitch, yaw in radians and their rates ``(3,)``.
    """

    time: float
    position: np.ndarray
    velocity: np.ndarray
    attitude: np.ndarray
    rates: np.ndarray
    landed: bool = False

    def pose(self, delay: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
        """Position and attitude `delay` seconds later (or earlier), by velocity and rates."""
        return self.position + delay * self.velocity, self.attitude + delay * self.rates


def _limit(vector: np.ndarray, longest: float) -> np.ndarray:
    length = math.hypot(*vector)
    return vector if length <= longest else vector * (longest / length)


class Vehicle:
    """A simulated quadrotor.

    Parameters
    ----------
    position : (2,) array
        Start in metres.
    height, speed : float
        Metres, held; metres a second, towards a goal.
    height_ripple, yaw : float
        Standard deviations of height (m) and heading (rad).
    rng : numpy.random.Generator
        Wind and controllers' noise.
    """

    def __init__(
        self,
        position: ArrayLike,
        *,
        height: float = 1.0,
        speed: float = 0.5,
        height_ripple: float = 0.03,
        yaw: float = 0.03,
        rng: np.random.Generator,
    ):
        self.speed = number(speed, "the vehicle's speed in m/s", above=0, high=3)
        self._rng = rng
        self._height = number(height, "the vehicle's height in metres", low=0.2, high=10)
        self._ripple = np.array([height_ripple, yaw])
        self._wander = rng.standard_normal(2) * self._ripple
        self._wander_rate = rng.standard_normal(2) * self._ripple * WANDER_FREQUENCY
        self._xy, self._velocity = np.array(position, dtype=float), np.zeros(2)
        self._tilt, self._tilt_rate = np.zeros(2), np.zeros(2)
        self._gust, self._jitter = rng.standard_normal(2) * GUST, np.zeros(2)
        self._steps = 0
        self._landing = self._landed = False

    @property
    def state(self) -> VehicleState:
        still = not self._landed
        descent = -DESCENT if self._landing else 0.0
        return VehicleState(
            time=self._steps * STEP,
            position=np.array([*self._xy, max(self._height + self._wander[0], TOUCHDOWN)]),
            velocity=np.array([*self._velocity, descent + self._wander_rate[0]]) * still,
            attitude=np.array([*self._tilt, self._wander[1]]),
            rates=np.array([*self._tilt_rate, self._wander_rate[1]]) * still,
            landed=self._landed,
        )

    def land(self) -> None:
        """Brake and come down; the vehicle still drifts until it touches the ground."""
        self._landing = True

    def teleport(self, position: ArrayLike) -> None:
        """Put the vehicle elsewhere, at rest (a kidnapping)."""
        self._xy, self._velocity = np.array(position, dtype=float), np.zeros(2)

    def advance(self, seconds: float, goal: ArrayLike | None = None) -> VehicleState:
        """Fly for `seconds` towards `goal` ((2,) metres; None: brake and hover)."""
        for _ in range(round(seconds / STEP)):
            self._steps += 1
            if not self._landed:
                brakes = goal is None or self._landing
                self._integrate(None if brakes else np.asarray(goal, dtype=float))
        return self.state

    def _integrate(self, goal: np.ndarray | None) -> None:
        noise = self._rng.standard_normal(6)
        self._gust += (
            -self._gust * STEP / GUST_TIME + GUST * math.sqrt(2 * STEP / GUST_TIME) * noise[:2]
        )
        self._jitter += (
            -self._jitter * STEP / JITTER_TIME
            + TILT_JITTER * math.sqrt(2 * STEP / JITTER_TIME) * noise[2:4]
        )
        # Damped oscillators driven by white noise: smooth, of the deviations asked for.
        frequency, damping = WANDER_FREQUENCY, 0.7
        kick = self._ripple * np.sqrt(4 * damping * frequency**3 * STEP) * noise[4:]
        pull = -(frequency**2) * self._wander - 2 * damping * frequency * self._wander_rate
        self._wander_rate = self._wander_rate + STEP * pull + kick
        self._wander = self._wander + STEP * self._wander_rate
        wanted = np.zeros(2) if goal is None else _limit(APPROACH * (goal - self._xy), self.speed)
        push = _limit(
            (wanted - self._velocity) / VELOCITY_LAG + DRAG * self._velocity, ACCELERATION
        )
        cosine, sine = math.cos(self._wander[1]), math.sin(self._wander[1])
        # Right side down pushes to the right, nose up pushes back (see trexton.vision.camera).
        command = (
            np.array([cosine * push[0] + sine * push[1], sine * push[0] - cosine * push[1]])
            / GRAVITY
            + self._jitter
        )
        self._tilt_rate += STEP * (
            TILT_FREQUENCY**2 * (command - self._tilt)
            - 2 * TILT_DAMPING * TILT_FREQUENCY * self._tilt_rate
        )
        self._tilt = self._tilt + STEP * self._tilt_rate
        right, forward = GRAVITY * math.tan(self._tilt[0]), -GRAVITY * math.tan(self._tilt[1])
        thrust = np.array([cosine * right - sine * forward, sine * right + cosine * forward])
        self._velocity = self._velocity + STEP * (thrust + self._gust - DRAG * self._velocity)
        self._xy = self._xy + STEP * self._velocity
        if self._landing:
            self._height -= DESCENT * STEP
            self._landed = self._height + self._wander[0] <= TOUCHDOWN
