"""Integrity: whether the estimate is lost, tested by a field that is learned beside the method.

The field says of every frame how much better it fits where the estimate is than a place drawn from
the whole area. A Markov chain of two states, here and elsewhere, adds that up over the frames.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from trexton.base.errors import ParameterError
from trexton.base.options import option
from trexton.field.field import Field
from trexton.localization.base import Part, learned
from trexton.localization.calibration import Judge, Replay
from trexton.localization.estimate import Estimate
from trexton.localization.observation import Observation
from trexton.localization.training_set import Training

__all__ = ["Elsewhere", "Integrity", "NoIntegrity"]

KIDNAP_PROBABILITY = 1e-3  # a frame, that a vehicle that was here is elsewhere
RETURN_PROBABILITY = 0.1  # the other way round: filters find their way back
CLUTTER_PROBABILITY = 1e-3  # that a frame fits no place better than another


@dataclass(eq=False)
class Integrity(Part):
    """Base of all integrity tests."""

    def open(self) -> Judge:
        """A judge for one flight."""
        return Judge()


@dataclass(eq=False)
class NoIntegrity(Integrity):
    """The filter's own word is passed on (the paper's filter never says that it is lost)."""


@dataclass(eq=False)
class Elsewhere(Field, Integrity):
    """Lost where the frames support other places.

    The covariance about the estimate is at most the usual one of the calibration: a filter that
    was kidnapped claims more, and must not be excused by it.
    """

    needs = {"calibration": Replay}
    doubt: float = option(
        0.5, "chance of being elsewhere from which on the vehicle is lost", above=0, below=1
    )
    usual: np.ndarray = learned()  # () metres, deviation along an axis

    def fit(self, training: Training) -> Self:
        """Learn the field, and take over the usual deviation of the calibration."""
        usual = training.parts["calibration"].usual
        return super().fit(training).with_learned(usual=usual)

    def prepare(self) -> None:
        super().prepare()
        if self.usual is not None and not (self.usual.shape == () and 0 < self.usual < np.inf):
            raise ParameterError(
                f"the integrity's usual deviation is {self.usual}: expected a positive length"
            )

    def open(self) -> Judge:
        return _Chain(self)

    def log_evidence(self, observation: Observation, estimate: Estimate) -> float:
        """Log of the frame's likelihood about the estimate over its mean over the area."""
        log_posterior = self.log_posterior(observation)
        shares = np.exp(log_posterior - log_posterior.max())
        covariance = estimate.about_position
        covariance = covariance * min(1.0, 2 * float(self.usual) ** 2 / float(np.trace(covariance)))
        inverse = np.linalg.inv(covariance + self.cell**2 / 12 * np.eye(2))
        offset = self.centers - estimate.position
        squared = np.einsum("ni,ij,nj->n", offset, inverse, offset)
        about = np.exp(-0.5 * (squared - squared.min()))
        return float(np.log(about @ shares / about.sum() / shares.mean() + 1e-300))


class _Chain(Judge):
    def __init__(self, test: Elsewhere):
        self._test = test
        self.reset()

    def reset(self) -> None:
        """Forget all frames; lost until some support the estimate."""
        self._elsewhere = 1 - KIDNAP_PROBABILITY

    def judge(self, estimate: Estimate, observation: Observation | None) -> Estimate:
        if observation is not None:
            here = 1 - self._elsewhere
            prior = (1 - RETURN_PROBABILITY) * self._elsewhere + KIDNAP_PROBABILITY * here
            evidence = np.exp(self._test.log_evidence(observation, estimate))
            fits = (1 - CLUTTER_PROBABILITY) * evidence + CLUTTER_PROBABILITY
            self._elsewhere = float(prior / (prior + (1 - prior) * fits))
        return replace(estimate, lost=self._elsewhere > self._test.doubt)
