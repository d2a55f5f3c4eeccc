"""The bias and the noise of a measured tilt: mount of the camera, trim of the autopilot, another
convention of signs. Offers `TiltError`, which estimates them from frame after frame.
"""

from __future__ import annotations

from itertools import product

import numpy as np

__all__ = ["TiltError"]

# Chosen on four floors, attitudes that are right, biased, wandering, jumping: see the protocol.
_USUAL = np.radians(1.0)  # standard deviation of an offset before anything was seen
_DRIFT = np.radians(0.03)  # of its change from frame to frame
_ALIKE = 20.0  # frames whose errors are alike: each counts so much less
_MEMORY = 50.0  # frames over which the noise is taken
_UNINFORMATIVE = 50.0  # times as uncertain as the measured tilt: such a frame says nothing
_LEAST_BIAS, _BIAS_SIGMA = np.radians(2.0), 5.0  # worth a warning: so much, so many deviations
# Roll and pitch as measured, and every other way to give them signs and order.
_ORDERS = (np.eye(2), np.eye(2)[::-1])
_CONVENTIONS = np.array(
    [np.diag(s) @ order for order in _ORDERS for s in product((1, -1), (1, -1))]
)
_CONVENTION_LOG_ODDS = 7.0  # log odds against another convention than the measured one
_LOG_ODDS_BOUND = 15.0  # log odds beyond which nothing is believed of one


class TiltError:
    """Learns from frame after frame the bias of the measured tilt, and its noise.

    The offset is that of a Kalman filter of a random walk, for roll and pitch apart; the noise is
    what is left, a mean of squares that forgets. Every convention of signs and order has both of
    its own, and the one that foretells the frames best is gone by.

    Parameters
    ----------
    sigma : float
        Standard deviation in radians that a measured tilt has at least.

    Attributes
    ----------
    best : int
        The convention gone by; 0 is roll and pitch as measured.
    """

    def __init__(self, sigma: float) -> None:
        count = len(_CONVENTIONS)
        self._least = sigma**2
        self._mean, self._variance = np.zeros((count, 2)), np.full((count, 2), _USUAL**2)
        self._squares = np.full((count, 2), self._least)
        self._evidence = np.array([0.0] + [-_CONVENTION_LOG_ODDS] * (count - 1))
        self.best = 0

    @property
    def mean(self) -> np.ndarray:
        """``(2,)`` radians that a measured roll and pitch lack, in the convention gone by."""
        return np.asarray(self._mean[self.best])

    @property
    def deviation(self) -> np.ndarray:
        """``(2,)`` radians: of what `corrected` gives."""
        noise = np.maximum(self._squares[self.best], self._least)
        return np.asarray(np.sqrt(noise + self._variance[self.best]))

    def corrected(self, measured: np.ndarray) -> np.ndarray:
        """``(2,)`` roll and pitch, from the measured ones; radians."""
        return np.asarray(_CONVENTIONS[self.best] @ measured + self.mean)

    @property
    def tilt_bias(self) -> np.ndarray | None:
        """``(2,)`` radians, the bias of what is measured, root mean square, with the sign of the
        offset; None unless that is certain and worth a word.
        """
        mean, variance, squares = self._mean[0], self._variance[0], self._squares[0]
        off = np.abs(mean) > np.maximum(_LEAST_BIAS, _BIAS_SIGMA * np.sqrt(variance))
        if not (off.any() or (squares > _LEAST_BIAS**2).any()):
            return None
        rough = np.maximum(squares - self._least, 0)
        return np.copysign(np.sqrt(mean**2 + rough), -mean)

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
        apart = seen - _CONVENTIONS @ measured - self._mean
        self._variance = self._variance + _DRIFT**2
        rest = apart**2 - self._variance - variance
        self._squares = self._squares + np.where(informative, (rest - self._squares) / _MEMORY, 0.0)
        # Without the noise that was learned: an offset looks like noise until it is learned itself.
        total = self._variance + _ALIKE * variance + self._least
        gain = np.where(informative, self._variance / total, 0.0)
        # With the noise that even the best convention leaves: such frames tell less.
        predicted = total + _ALIKE * np.maximum(self._squares, 0).min(axis=0)
        # Twice the negative log predictive density.
        deviance = np.where(informative, apart**2 / predicted + np.log(predicted), 0.0).sum(axis=1)
        evidence = self._evidence - deviance / 2
        self._evidence = np.maximum(evidence - evidence.max(), -_LOG_ODDS_BOUND)
        self.best = int(np.argmax(self._evidence))
        self._mean = self._mean + gain * apart
        self._variance = (1 - gain) * self._variance
