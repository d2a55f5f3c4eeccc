"""What is expected of a frame's pose before it is compared with the floor. Offers `PosePrior`,
which joins the autopilot's attitude, as far as it agrees, with the frame before."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from trexton.registration.alignment import Alignment
from trexton.registration.trust import FloorFix
from trexton.vision.camera import wrapped

ALL_HEADINGS = np.linspace(-np.pi, np.pi, 36, endpoint=False)
ALL_HEADINGS.setflags(write=False)
_TURN = np.radians(10.0)  # that a vehicle turns at most from frame to frame
_TILT, _HEIGHT, _HEADING = 0.07, 0.1, np.pi / 36  # known of them unmeasured: rad, share, rad
_BETWEEN = np.array([0.03, 0.03])  # from frame to frame: height, a share of it; heading, rad
_LITTLE = 0.02  # share of a tilt that was found which the frame, not the prior, must have said
_MEMORY = 20.0  # frames over which the change of the tilt is taken
_FARTHEST = 10.0  # times the usual height, or a part of it: beyond, the sensor errs
_MOST_FAILURES = 25  # frames lost, after which measured heading and height are left, or tried again
_AGREES, _ABOUT = np.radians(5.0), 0.1  # heading and height, a share, as found and as measured
# Of a measured tilt; chosen on four floors, attitudes that are right, biased, wandering, jumping:
# see the protocol.
_USUAL = np.radians(1.0)  # standard deviation of an offset before anything was seen
_DRIFT = np.radians(0.03)  # of its change from frame to frame
_ALIKE = 20.0  # frames whose errors are alike: each counts so much less
_TILT_MEMORY = 50.0  # frames over which the noise is taken
_UNINFORMATIVE = 50.0  # times as uncertain as the measured tilt: such a frame says nothing
_LEAST_BIAS, _BIAS_SIGMA = np.radians(2.0), 5.0  # worth a warning: so much, so many deviations


@dataclass(frozen=True, eq=False)
class Prior:
    """The pose expected of a frame.

    Attributes
    ----------
    mean, deviation : (6,) arrays
        Of x, y, z, roll, pitch and yaw, as if it were at x = y = 0; metres and radians.
    turned : bool
        Whether the heading is the measured one.
    tilt : (2,) array or None, as measured
    heading, height : float or None, as measured
    last : (6,) array or None
        The pose of the frame before, if it was found.
    steps : int
        Frames since then: more than one where some did not come.
    """

    mean: np.ndarray
    deviation: np.ndarray
    turned: bool
    tilt: np.ndarray | None
    heading: float | None
    height: float | None
    last: np.ndarray | None
    steps: int

    @property
    def headings(self) -> np.ndarray:
        """Headings to search: the measured one, those near the last one, or all; radians."""
        if self.turned:
            return self.mean[5:].copy()
        if self.last is not None:
            return np.asarray(self.last[5] + _TURN * np.arange(-self.steps, self.steps + 1))
        return ALL_HEADINGS


@dataclass(frozen=True, eq=False)
class Seen:
    """A shrunken frame, what is expected of its pose, and the view's motion."""

    frame: np.ndarray
    prior: Prior
    moved: np.ndarray
    sure: float


class TiltError:
    """The bias and the noise of a measured tilt, learned from frame after frame: mount of the
    camera, trim of the autopilot.

    The bias is that of a Kalman filter of a random walk, for roll and pitch apart; the noise is
    what is left, a mean of squares that forgets.

    Parameters
    ----------
    sigma : float
        Standard deviation in radians that a measured tilt has at least.

    Attributes
    ----------
    mean : (2,) array
        Radians that a measured roll and pitch lack.
    """

    def __init__(self, sigma: float) -> None:
        self._least = sigma**2
        self.mean, self._variance = np.zeros(2), np.full(2, _USUAL**2)
        self._squares = np.full(2, self._least)

    @property
    def deviation(self) -> np.ndarray:
        """``(2,)`` radians, of a measured tilt plus `mean`."""
        return np.asarray(np.sqrt(np.maximum(self._squares, self._least) + self._variance))

    @property
    def tilt_bias(self) -> np.ndarray | None:
        """``(2,)`` radians, the bias of what is measured, root mean square, with the sign of the
        offset; None unless that is certain and worth a word.
        """
        off = np.abs(self.mean) > np.maximum(_LEAST_BIAS, _BIAS_SIGMA * np.sqrt(self._variance))
        if not (off.any() or (self._squares > _LEAST_BIAS**2).any()):
            return None
        rough = np.maximum(self._squares - self._least, 0)
        return np.copysign(np.sqrt(self.mean**2 + rough), -self.mean)

    def learn(self, measured: np.ndarray, seen: np.ndarray, variance: np.ndarray) -> None:
        """Learn from a frame that was found.

        Parameters
        ----------
        measured, seen : (2,) arrays
            Roll and pitch as measured, and as the frame alone has them, in radians.
        variance : (2,) array
            Of what was seen.
        """
        informative = variance < _UNINFORMATIVE * self.deviation**2
        apart = seen - measured - self.mean
        self._variance = self._variance + _DRIFT**2
        rest = apart**2 - self._variance - variance
        self._squares = self._squares + np.where(
            informative, (rest - self._squares) / _TILT_MEMORY, 0.0
        )
        # Without the noise that was learned: an offset looks like noise until it is learned itself.
        total = self._variance + _ALIKE * variance + self._least
        gain = np.where(informative, self._variance / total, 0.0)
        self.mean = self.mean + gain * apart
        self._variance = (1 - gain) * self._variance


class PosePrior:
    """How much to believe of the attitude and the height that an autopilot tells.

    Of roll and pitch it is learned how far they are off. Heading and height are used (as
    `uses_heading` says) as long as the floor is found with them; else it is searched without.

    Parameters
    ----------
    usual : float
        Height of the camera in metres while none is measured.
    attitude_sigma, height_sigma : float
        Standard deviations of the measured attitude and height, radians and metres.
    """

    def __init__(self, usual: float, attitude_sigma: float, height_sigma: float):
        self.usual, self.attitude_sigma, self.height_sigma = usual, attitude_sigma, height_sigma
        self.tilt = TiltError(attitude_sigma)
        self._change = _BETWEEN[1] ** 2  # of the tilt from frame to frame, radians squared
        self.uses_heading = True
        self._failures = 0  # frames that heading and height found nothing, or none did

    def prior(
        self, attitude: ArrayLike | None, height: float | None, last: np.ndarray | None, steps: int
    ) -> Prior:
        """From what was measured with a frame, and the ``(6,)`` pose `steps` before, if found.

        NaN is what nobody knows; a height of another order than usual is not believed.
        """
        measured = np.full(3, np.nan) if attitude is None else np.array(attitude, dtype=float)
        if height is not None and not 1 / _FARTHEST < height / self.usual < _FARTHEST:
            height = None
        mean = np.array([0, 0, self.usual, 0, 0, 0.0])
        deviation = np.array([np.inf, np.inf, _HEIGHT * self.usual, _TILT, _TILT, _HEADING])
        if last is not None:
            mean[[2, 5]] = last[[2, 5]]
            deviation[[2, 5]] = steps * _BETWEEN * (last[2], 1)
            change = steps * self._change
            share = _TILT**2 / (_TILT**2 + change)  # of a tilt that stays within its bounds
            mean[3:5], deviation[3:5] = share * last[3:5], np.sqrt(share * change)
        given = np.isfinite(measured)
        heading = float(measured[2]) if given[2] else None
        given[2] &= self.uses_heading
        tilt = measured[:2] if given[:2].all() else None
        if tilt is not None:
            better = self.tilt.deviation < deviation[3:5]
            mean[3:5] = np.where(better, tilt + self.tilt.mean, mean[3:5])
            deviation[3:5] = np.where(better, self.tilt.deviation, deviation[3:5])
        if given[2]:
            mean[5], deviation[5] = measured[2], self.attitude_sigma
        if height is not None and self.uses_heading:
            mean[2], deviation[2] = height, self.height_sigma
        return Prior(mean, deviation, bool(given[2]), tilt, heading, height, last, steps)

    def learn(self, prior: Prior, aligned: Alignment) -> None:
        """From a frame that was found where `aligned` says, its `prior` counted in."""
        expected, sigma = prior.mean[3:5], prior.deviation[3:5]
        left = aligned.covariance.diagonal()[3:5]
        said = np.maximum(1 - left / sigma**2, _LITTLE)
        # What the frame says alone, without what was expected of it.
        tilt, left = expected + (aligned.pose[3:5] - expected) / said, left / said
        if prior.last is not None:
            change = np.square(tilt - prior.last[3:5]).mean() / prior.steps
            self._change = max(_BETWEEN[1] ** 2, self._change + (change - self._change) / _MEMORY)
        if prior.tilt is not None:
            self.tilt.learn(prior.tilt, tilt, left)

    def reject(self, prior: Prior, fix: FloorFix, recognized: bool) -> bool:
        """Whether to start again, from now on without measured heading and height, or with them."""
        if prior.heading is None and prior.height is None:
            return False
        if not fix.lost:
            self._failures = max(0, self._failures - 2)
            heading, height = prior.heading, prior.height
            turned = heading is not None and abs(wrapped(fix.pose[5] - heading)) >= _AGREES
            about = height is None or abs(height / fix.pose[2] - 1) < _ABOUT
            self.uses_heading |= about and not turned
            return False
        self._failures += not recognized
        if self._failures < _MOST_FAILURES:
            return False
        self.uses_heading, self._failures = not self.uses_heading, 0
        return True
