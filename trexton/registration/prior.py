"""What is expected of a frame's pose before it is compared with the floor. Offers `PosePrior`,
which joins the autopilot's attitude, as far as it agrees, with the frame before."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from trexton.registration.alignment import Alignment
from trexton.registration.tilt import TiltError
from trexton.registration.trust import FloorFix
from trexton.vision.camera import wrapped

Array = NDArray[Any]

__all__ = ["ALL_HEADINGS", "PosePrior", "Prior", "Seen"]

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


@dataclass(frozen=True, eq=False)
class Prior:
    """The pose expected of a frame.

    Attributes
    ----------
    mean, deviation : (6,) arrays
        Of x, y, z, roll, pitch and yaw, as if it were at x = y = 0; metres and radians.
    turned : bool
        Whether the heading is the measured one.
    tilt : (2,) array or None
        Roll and pitch as measured.
    heading, height : float or None
        As measured, believed or not.
    last : (6,) array or None
        The pose of the frame before, if it was found.
    steps : int
        Frames since then: more than one where some did not come.
    """

    mean: Array
    deviation: Array
    turned: bool
    tilt: Array | None
    heading: float | None
    height: float | None
    last: Array | None
    steps: int

    @property
    def headings(self) -> Array:
        """Headings to search: the measured one, those near the last one, or all; radians."""
        if self.turned:
            return self.mean[5:].copy()
        if self.last is not None:
            return np.asarray(self.last[5] + _TURN * np.arange(-self.steps, self.steps + 1))
        return ALL_HEADINGS


@dataclass(frozen=True, eq=False)
class Seen:
    """A shrunken frame, what is expected of its pose, and the view's motion."""

    frame: Array
    prior: Prior
    moved: Array
    sure: float


class PosePrior:
    """How much to believe of the attitude and the height that an autopilot tells.

    Of roll and pitch it is learned how far they are off. Heading and height are used as long as
    the floor is found with them; else it is searched without, by turns.

    Parameters
    ----------
    usual : float
        Height of the camera in metres while none is measured.
    attitude_sigma, height_sigma : float
        Standard deviations of the measured attitude and height, radians and metres.

    Attributes
    ----------
    tilt : TiltError
    uses_heading : bool
        Whether the measured heading and height are used.
    """

    def __init__(self, usual: float, attitude_sigma: float, height_sigma: float):
        self.usual, self.attitude_sigma, self.height_sigma = usual, attitude_sigma, height_sigma
        self.tilt = TiltError(attitude_sigma)
        self._change = _BETWEEN[1] ** 2  # of the tilt from frame to frame, radians squared
        self.uses_heading = True
        self._failures = 0  # frames that heading and height found nothing, or none did

    def prior(
        self, attitude: ArrayLike | None, height: float | None, last: Array | None, steps: int = 1
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
            mean[3:5] = np.where(better, self.tilt.corrected(tilt), mean[3:5])
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
            self.uses_heading |= _agree(prior, fix.pose)
            return False
        self._failures += not recognized
        if self._failures < _MOST_FAILURES:
            return False
        self.uses_heading, self._failures = not self.uses_heading, 0
        return True


def _agree(prior: Prior, pose: Array) -> bool:
    """Whether heading and height are about the measured ones."""
    heading, height = prior.heading, prior.height
    turned = heading is not None and abs(wrapped(pose[5] - heading)) >= _AGREES
    return not turned and (height is None or abs(height / pose[2] - 1) < _ABOUT)
