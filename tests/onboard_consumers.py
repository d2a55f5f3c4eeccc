"""Two receivers of positions, written from the autopilots' published equations, not from this
project's code: what a vehicle would believe if it fused what it is told.

Both take each measurement for independent of all others and use the diagonal alone, as PX4's EKF2
and ArduPilot's EKF3 do, and refuse an innovation beyond their gate.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from functools import cache

import numpy as np

CHI2_90 = -2 * math.log(0.1)  # of two degrees of freedom


@dataclass
class Consumer:
    """A Kalman filter a horizontal axis, of position and velocity.

    An accelerometer drives it, whose readings err by `acceleration_noise`, independently. The
    variance of a measurement is floored at `floor` squared; an innovation beyond `gate` deviations
    is refused, and after `patience` seconds of refusals the position is reset to what is told.
    """

    acceleration_noise: float = 0.35  # m/s^2, PX4's EKF2_ACC_NOISE and ArduPilot's EK3_ACC_P_NSE
    floor: float = 0.1
    gate: float = 5.0
    joint: bool = False
    patience: float = 5.0
    state: np.ndarray | None = None
    covariance: np.ndarray = field(default_factory=lambda: np.eye(4))
    refused_since: float | None = None
    nis: list[float] = field(default_factory=list)

    def tell(self, time: float, position: np.ndarray, variances: np.ndarray) -> None:
        """Fuse one position of now: ``(2,)`` metres, ``(2,)`` square metres."""
        noise = np.maximum(variances, self.floor**2)
        if self.state is None:
            self._start(time, position, noise)
            return
        innovation = position - self.state[:2]
        spread = np.diagonal(self.covariance)[:2] + noise
        ratios = innovation**2 / spread
        self.nis.append(float(ratios.sum()))
        passed = [ratios.sum() <= 2 * self.gate**2] * 2 if self.joint else ratios <= self.gate**2
        if not all(passed):
            self.refused_since = time if self.refused_since is None else self.refused_since
            if time - self.refused_since > self.patience:
                self._start(time, position, noise)
                return
        else:
            self.refused_since = None
        for axis in np.flatnonzero(passed):
            gain = self.covariance[:, axis] / (self.covariance[axis, axis] + noise[axis])
            self.state = self.state + gain * (position[axis] - self.state[axis])
            keep = np.eye(4) - np.outer(gain, np.eye(4)[axis])
            self.covariance = keep @ self.covariance @ keep.T + np.outer(gain, gain) * noise[axis]

    def inside(self, truth: np.ndarray, threshold: float = CHI2_90) -> bool:
        """Whether the truth lies in the ellipse that is believed to hold it 9 times in 10."""
        error = truth - self.state[:2]
        return float(error @ np.linalg.solve(self.covariance[:2, :2], error)) <= threshold

    def _start(self, time: float, position: np.ndarray, noise: np.ndarray) -> None:
        self.refused_since = None
        self.state = np.r_[position, 0.0, 0.0]
        self.covariance = np.diag(np.r_[noise, 4.0, 4.0])

    def drive(self, acceleration: np.ndarray, dt: float) -> None:
        """Go on by `dt` seconds with what the accelerometer reads, ``(2,)`` m/s^2."""
        if self.state is None:
            return
        step, push, noise = _motion(dt, self.acceleration_noise)
        self.state = step @ self.state + push @ acceleration
        self.covariance = step @ self.covariance @ step.T + noise


@cache
def _motion(dt: float, noise: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The transition, how an acceleration enters, and the covariance that its noise adds."""
    push = np.vstack([dt**2 * np.eye(2), dt * np.eye(2)])
    return np.eye(4) + dt * np.eye(4, k=2), push, noise**2 * push @ push.T


def ekf2() -> Consumer:
    """PX4's: axis by axis, gate of 5 deviations, floor of EKF2_EVP_NOISE."""
    return Consumer()


def ekf3() -> Consumer:
    """ArduPilot's: both axes judged together, floor of VISO_POS_M_NSE."""
    return Consumer(floor=0.2, joint=True)


@dataclass
class Delayed:
    """A consumer as it stands in the autopilot: behind a buffer, at a delayed time horizon.

    A message is kept unless its stamp is less than `min_interval_s` after the last one's ("EV data
    too fast"). The filter runs `horizon_s` behind the clock and fuses the newest that its horizon
    has passed, within a tenth of a second; older ones are thrown away. It begins with the second of
    two stamps less than `start_s` apart, and stops, to begin anew, `stop_s` after the last.
    """

    consumer: Consumer
    horizon_s: float = 0.2
    min_interval_s: float = 0.0105
    start_s: float = 0.2
    stop_s: float = 0.4
    size: int = 20
    last_stamp: float = -math.inf
    fused_at: float = -math.inf
    dropped: list[float] = field(default_factory=list)
    stops: int = 0
    begun: bool = False

    def __post_init__(self) -> None:
        self.buffer: deque[tuple[float, np.ndarray, np.ndarray]] = deque(maxlen=self.size)
        self.inertial: deque[tuple[float, np.ndarray]] = deque()

    def receive(self, stamp: float, position: np.ndarray, variances: np.ndarray) -> None:
        """A message has come."""
        if stamp < self.last_stamp + self.min_interval_s:
            self.dropped.append(stamp)
            return
        self.last_stamp = stamp
        self.buffer.append((stamp, position, variances))

    def tick(self, now: float, acceleration: np.ndarray, dt: float) -> None:
        """The accelerometer has read: go on by `dt` seconds at the horizon."""
        self.inertial.append((now, acceleration))
        horizon = now - self.horizon_s
        if self.inertial[0][0] > horizon:
            return
        self.consumer.drive(self.inertial.popleft()[1], dt)
        horizon += dt
        passed = None
        while self.buffer and self.buffer[0][0] <= horizon + 1e-6:
            passed = self.buffer.popleft()
        if passed is not None and horizon < passed[0] + 0.1:
            self.begun = self.begun or passed[0] - self.fused_at < self.start_s
            self.fused_at = passed[0]
            if self.begun:
                self.consumer.tell(*passed)
        elif self.begun and horizon - self.fused_at > self.stop_s:
            self.begun, self.stops = False, self.stops + 1


def readings(positions: np.ndarray, dt: float, rng: np.random.Generator) -> np.ndarray:
    """``(N, 2)`` what an accelerometer reads from each frame to the next along a known track."""
    padded = np.vstack(
        [2 * positions[0] - positions[1], positions, 2 * positions[-1] - positions[-2]]
    )
    exact = np.diff(padded, 2, axis=0) / dt**2
    noise: np.ndarray = rng.normal(0.0, Consumer.acceleration_noise, exact.shape)
    return exact + noise
