"""How far a measured tilt is off: the camera's mount, the autopilot's trim."""

from __future__ import annotations

import numpy as np

__all__ = ["TiltOffset"]

# Chosen on four floors, told attitudes that are right, off, wandering, jumping: see the protocol.
_USUAL = np.radians(1.0)  # standard deviation of an offset before anything was seen
_DRIFT = np.radians(0.03)  # of its change from frame to frame
_ALIKE = 20.0  # frames whose errors are alike: each counts so much less
_LITTLE = 0.02  # share of what was found that the frame, not the prior, must have said
_ASKEW, _BEYOND = np.radians(2.0), 5.0  # worth telling a person: so much, and so many deviations


class TiltOffset:
    """Learns from frame after frame how far the tilt that is told is off.

    A Kalman filter of a random walk, for roll and pitch apart. It hears what a frame says alone:
    what the alignment found, without what was expected of the tilt.

    Attributes
    ----------
    mean, variance : (2,) arrays
        Of what a measured roll and pitch lack, in radians and radians squared.
    """

    def __init__(self) -> None:
        self.mean, self.variance = np.zeros(2), np.full(2, _USUAL**2)

    @property
    def askew(self) -> np.ndarray | None:
        """``(2,)`` radians by which what is told is off, where that is certain and worth a word."""
        sure = np.abs(self.mean) > np.maximum(_ASKEW, _BEYOND * np.sqrt(self.variance))
        return -self.mean if sure.any() else None

    def learn(
        self, expected: np.ndarray, found: np.ndarray, noise: float, left: np.ndarray
    ) -> None:
        """Learn from a frame that was found.

        Parameters
        ----------
        expected, found : (2,) arrays
            Roll and pitch as told plus `mean`, and those at which the frame fits best, what was
            expected counted in, in radians.
        noise : float
            Variance of what is told but for the offset.
        left : (2,) array
            Variances of what was found.
        """
        said = 1 - left / (noise + self.variance)
        heard = said > _LITTLE
        said = np.where(heard, said, 1.0)
        alone = _ALIKE * left / said + noise
        self.variance = self.variance + _DRIFT**2
        gain = np.where(heard, self.variance / (self.variance + alone), 0.0)
        self.mean = self.mean + gain * (found - expected) / said
        self.variance = (1 - gain) * self.variance
