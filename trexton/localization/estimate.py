"""What one step of the localizer gives. Offers `Estimate`, and the `Measurement` that an autopilot
may fuse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trexton.localization.neighbors import Neighbors

CHI2_90 = float(-2 * np.log(0.1))  # of two degrees of freedom
LOST_SHARE = float(np.sqrt(6 / (np.pi * CHI2_90)))  # of ignorance: .64, see `Estimate.lost_in`


@dataclass(frozen=True, eq=False, slots=True)
class Measurement:
    """A position fit to be fused by somebody else.

    Attributes
    ----------
    position : (2,) array, metres
    covariance : (2, 2) array
        Of this one's error, square metres.
    independent_s : float
        Seconds between two whose errors are as good as independent; 0 where each is.
    """

    position: np.ndarray
    covariance: np.ndarray
    independent_s: float = 0.0


@dataclass(frozen=True, eq=False, slots=True)
class Estimate:
    """What one step gives, and what it saw and drew on the way.

    Attributes
    ----------
    position : (2,) array
        Point estimate in metres.
    covariance : (2, 2) array
        Of the belief about its mean, square metres; about `position` where there is no `mean`.
    lost : bool
        The position must not be trusted.
    observed : bool
        False where the step only predicted.
    histogram : (K,) array or None
    neighbors : Neighbors or None
        Both where a part asked for them.
    mean : (2,) array or None
        Of the belief, in metres, where `position` is another point.
    particles : (M, 2) array or None
        Positions in metres; None from a filter that has none.
    weights : (M,) array or None
        Of these particles, before resampling.
    measurement : Measurement or None
        What of it somebody else may fuse; None where the frame says nothing, or nobody knows how
        well.
    velocity : (2,) array or None
        Metres a second; None from a filter that has none.
    joint : (4, 4) array or None
        Covariance of position and velocity together, where there is a velocity.
    velocity_bias : (2,) array or None
        Of the aiding velocity, metres a second, where the frames contradict it or no vehicle flies
        so; None where they do not, or there is none.
    tilt_bias : (2,) array or None
        Of the aiding roll and pitch, radians, where the frames leave no doubt and it is worth a
        warning; None where it is not, or there are none.
    heading : float or None
        Yaw of the vehicle's nose, radians anticlockwise from the map's +y, as this frame shows it;
        None where it does not, or where the method estimates none.
    heading_sigma : float or None
        Its standard deviation, radians.
    """

    position: np.ndarray
    covariance: np.ndarray
    lost: bool = False
    observed: bool = True
    histogram: np.ndarray | None = None
    neighbors: Neighbors | None = None
    mean: np.ndarray | None = None
    particles: np.ndarray | None = None
    weights: np.ndarray | None = None
    measurement: Measurement | None = None
    velocity: np.ndarray | None = None
    joint: np.ndarray | None = None
    velocity_bias: np.ndarray | None = None
    tilt_bias: np.ndarray | None = None
    heading: float | None = None
    heading_sigma: float | None = None

    def ahead(self, seconds: float) -> tuple[np.ndarray, np.ndarray]:
        """``(2,)`` position and ``(2, 2)`` covariance in metres if the velocity lasts so long.

        The position and covariance as they are where no velocity is known.
        """
        if self.velocity is None or self.joint is None:
            return self.position, self.covariance
        carry = np.hstack([np.eye(2), seconds * np.eye(2)])
        return self.position + seconds * self.velocity, carry @ self.joint @ carry.T

    def for_fusion(self, period_s: float) -> Measurement:
        """The measurement for an autopilot that is sent one every `period_s` and takes each for
        independent; the filter's own covariance where there is none.

        Covariance inflation: all measurements that share an error together weigh as much as one.
        """
        own = self.measurement
        if own is None:
            return Measurement(self.position, self.about_position)
        factor = max(1.0, own.independent_s / period_s)
        return Measurement(own.position, factor * own.covariance, own.independent_s)

    def lost_in(self, area: tuple[float, float, float, float]) -> bool:
        """Whether it must not be trusted: it says so, or it tells next to nothing of the area.

        A 90 % region of deviation s along each axis covers pi s^2 `CHI2_90`, of a square of side a
        half at s = .186 a: that is `LOST_SHARE` of a / sqrt(12), if only the area is known.
        """
        wide = np.sqrt(np.trace(self.about_position))
        return self.lost or not wide <= LOST_SHARE * float(np.hypot(*ignorance(area)))

    @property
    def spread(self) -> np.ndarray:
        """``(2,)`` standard deviations in metres, the paper's uncertainty."""
        return np.sqrt(np.diagonal(self.covariance))

    @property
    def about_position(self) -> np.ndarray:
        """``(2, 2)`` second moment of the belief about `position`, square metres.

        A point estimate that is a particle is not the mean: a receiver that takes it for the centre
        needs the spread about it, which is larger by the outer product of their difference.
        """
        if self.mean is None:
            return self.covariance
        offset = self.mean - self.position
        return self.covariance + np.outer(offset, offset)


def nowhere(area: tuple[float, float, float, float]) -> Estimate:
    """Of a vehicle of which nothing but the area is known: its middle, lost."""
    low, high = np.reshape(area, (2, 2)).T
    return Estimate((low + high) / 2, np.diag((high - low) ** 2 / 12), lost=True, observed=False)


def ignorance(area: tuple[float, float, float, float]) -> np.ndarray:
    """``(2,)`` standard deviations of a position of which only the area is known, metres."""
    x_min, x_max, y_min, y_max = area
    return np.array([x_max - x_min, y_max - y_min]) / np.sqrt(12)
