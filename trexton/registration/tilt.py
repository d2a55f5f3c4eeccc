"""How wrong a told tilt is: the camera's mount, the autopilot's trim, an axis of another sign."""

from __future__ import annotations

import numpy as np

__all__ = ["TiltError"]

# Chosen on four floors, told attitudes that are right, off, wandering, jumping: see the protocol.
_USUAL = np.radians(1.0)  # standard deviation of an offset before anything was seen
_DRIFT = np.radians(0.03)  # of its change from frame to frame
_ALIKE = 20.0  # frames whose errors are alike: each counts so much less
_MEMORY = 50.0  # frames over which the noise is taken
_LITTLE = 0.02  # share of what was found that the frame, not the prior, must have said
_ASKEW, _BEYOND = np.radians(2.0), 5.0  # worth telling a person: so much, and so many deviations


class TiltError:
    """Learns from frame after frame how far the tilt that is told is off, and how noisy it is.

    The offset is that of a Kalman filter of a random walk, for roll and pitch apart; the noise is
    what is left, a mean of squares that forgets. Both hear what a frame says alone: what the
    alignment found, without what was expected of the tilt.

    Parameters
    ----------
    sigma : float
        Standard deviation in radians that a measured tilt has at least.

    Attributes
    ----------
    mean, variance : (2,) arrays
        Of what a measured roll and pitch lack, in radians and radians squared.
    """

    def __init__(self, sigma: float) -> None:
        self.mean, self.variance = np.zeros(2), np.full(2, _USUAL**2)
        self._least = sigma**2
        self._squares = np.full(2, self._least)

    @property
    def noise(self) -> np.ndarray:
        """``(2,)`` variance of a measured roll and pitch but for the offset, radians squared."""
        return np.maximum(self._squares, self._least)

    @property
    def deviation(self) -> np.ndarray:
        """``(2,)``: of a measured roll and pitch once the offset is taken off."""
        return np.asarray(np.sqrt(self.noise + self.variance))

    @property
    def askew(self) -> np.ndarray | None:
        """``(2,)`` radians by which what is told is off, root mean square, with the sign of the
        offset; None unless that is certain and worth a word.
        """
        off = np.abs(self.mean) > np.maximum(_ASKEW, _BEYOND * np.sqrt(self.variance))
        if not (off.any() or (self.noise > _ASKEW**2).any()):
            return None
        rough = np.maximum(self.noise - self._least, 0)
        return np.copysign(np.sqrt(self.mean**2 + rough), -self.mean)

    def learn(self, expected: np.ndarray, found: np.ndarray, left: np.ndarray) -> None:
        """Learn from a frame that was found.

        Parameters
        ----------
        expected, found : (2,) arrays
            Roll and pitch as told plus `mean`, and those at which the frame fits best, what was
            expected counted in, in radians.
        left : (2,) array
            Variances of what was found.
        """
        said = 1 - left / self.deviation**2
        heard = said > _LITTLE
        said = np.where(heard, said, 1.0)
        apart, alone = (found - expected) / said, left / said
        self.variance = self.variance + _DRIFT**2
        rest = apart**2 - self.variance - alone
        self._squares = self._squares + np.where(heard, (rest - self._squares) / _MEMORY, 0.0)
        # Without the noise that was learnt: an offset looks like noise until it is learnt itself.
        total = self.variance + _ALIKE * alone + self._least
        gain = np.where(heard, self.variance / total, 0.0)
        self.mean = self.mean + gain * apart
        self.variance = (1 - gain) * self.variance
