"""What an autopilot comes to believe when it fuses positions: filters after the published equations
of PX4's EKF2 and ArduPilot's EKF3, as far as a horizontal position is concerned.

Both drive position and velocity by the accelerometer, take each report for independent of all
others and refuse innovations beyond their gate. Neither couples the axes where the report does not,
so each axis is a filter of two states.
"""

from typing import NamedTuple

import numpy as np

ACCELERATION_NOISE = 0.35  # m/s^2 a reading: EKF2_ACC_NOISE, EK3_ACC_P_NSE
RESET_S = 5.0  # of refusals, then the position is reset to the report
GATE = 5.0  # deviations beyond which an innovation is refused
FIRST_SPEED = 2.0  # m/s, prior deviation of the velocity


class Settings(NamedTuple):
    """What tells the two apart."""

    label: str
    floor: float  # least deviation in metres of a report: EKF2_EVP_NOISE, VISO_POS_M_NSE
    joint: bool = False  # whether both axes are refused or taken together


RECEIVERS = {"ekf2": Settings("EKF2", 0.1), "ekf3": Settings("EKF3", 0.2, joint=True)}


class Receiver:
    """So many vehicles at once, each with an accelerometer of its own; arrays ``(R, 2)``, metres.

    Attributes
    ----------
    position, velocity : arrays
    variance, cross, speed_variance : arrays
        Of the position, of both, of the velocity, along each axis.
    begun : bool
    """

    def __init__(self, settings: Settings, vehicles: int):
        self.settings = settings
        self.position, self.velocity = np.zeros((vehicles, 2)), np.zeros((vehicles, 2))
        self.variance = self.cross = self.speed_variance = np.zeros((vehicles, 2))
        self._refused_since = np.full((vehicles, 2), np.inf)
        self.begun = False

    def drive(self, acceleration: np.ndarray, dt: float) -> None:
        """Go on by `dt` seconds with what the accelerometers read."""
        noise = ACCELERATION_NOISE**2
        self.velocity = self.velocity + dt * acceleration
        self.position = self.position + dt * self.velocity
        self.variance = (
            self.variance + 2 * dt * self.cross + dt**2 * self.speed_variance + noise * dt**4
        )
        self.cross = self.cross + dt * self.speed_variance + noise * dt**3
        self.speed_variance = self.speed_variance + noise * dt**2

    def fuse(self, time: float, position: np.ndarray, variances: np.ndarray) -> None:
        """Take in one report of ``(2,)`` metres and square metres at `time`, in seconds."""
        noise = np.maximum(variances, self.settings.floor**2)
        if not self.begun:
            self.begun = True
            self._restart(np.ones(self.position.shape, bool), position, noise)
            return
        innovation = position - self.position
        expected = self.variance + noise
        squared = innovation**2 / expected
        taken = squared <= GATE**2
        if self.settings.joint:
            together = squared.mean(axis=1, keepdims=True) <= GATE**2
            taken = np.broadcast_to(together, squared.shape)
        gain = np.where(taken, self.variance / expected, 0)
        turned = np.where(taken, self.cross / expected, 0)
        self.position = self.position + gain * innovation
        self.velocity = self.velocity + turned * innovation
        self.speed_variance = self.speed_variance - turned * self.cross
        self.cross = (1 - gain) * self.cross
        self.variance = (1 - gain) * self.variance
        since = np.minimum(self._refused_since, time)
        self._refused_since = np.where(taken, np.inf, since)
        self._restart(time - self._refused_since > RESET_S, position, noise)

    def _restart(self, which: np.ndarray, position: np.ndarray, noise: np.ndarray) -> None:
        self.position = np.where(which, position, self.position)
        self.velocity = np.where(which, 0.0, self.velocity)
        self.variance = np.where(which, noise, self.variance)
        self.cross = np.where(which, 0.0, self.cross)
        self.speed_variance = np.where(which, FIRST_SPEED**2, self.speed_variance)
        self._refused_since = np.where(which, np.inf, self._refused_since)


def readings(
    positions: np.ndarray, time: np.ndarray, vehicles: int, rng: np.random.Generator
) -> np.ndarray:
    """``(N - 1, R, 2)`` what accelerometers read from each frame to the next along a known track.

    Without noise, `Receiver.drive` follows the ``(N, 2)`` positions exactly.
    """
    dt = np.diff(time)[:, None]
    velocity = np.diff(positions, axis=0) / dt
    exact = np.diff(velocity, axis=0, prepend=velocity[:1]) / dt
    noise: np.ndarray = rng.normal(0.0, ACCELERATION_NOISE, (len(exact), vehicles, 2))
    return noise + exact[:, None]
