"""Lost or not: a test of its own, whatever the filter thinks of itself.

A field of the floor, learned beside the method, says of every frame how much better it fits where
the estimate is than a place drawn from the whole area. A chain of two states, here and elsewhere,
adds that up over the frames.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from trexton.base.errors import MapError, ParameterError
from trexton.base.options import option
from trexton.field.field import Field
from trexton.localization.base import Part, Training, learned
from trexton.localization.calibration import Judge, Passing, Replay
from trexton.localization.estimate import Estimate
from trexton.localization.observation import Observation

__all__ = ["Elsewhere", "Integrity", "NoIntegrity"]

CARRIED = 1e-3  # chance a frame that a vehicle that was here is elsewhere
RETURNED = 0.1  # and the other way round: filters find their way back
ODD = 1e-3  # share of frames that fit no place better than another, whatever they look like


@dataclass(eq=False)
class Integrity(Part):
    """Base of all integrity tests."""

    def open(self) -> Judge:
        """A judge for one flight."""
        raise NotImplementedError


@dataclass(eq=False)
class NoIntegrity(Integrity):
    """The filter's own word is passed on (the paper's filter never says that it is lost)."""

    def open(self) -> Judge:
        return Passing()


@dataclass(eq=False)
class Elsewhere(Field, Integrity):
    """Lost where the frames speak for other places.

    What counts as here is what the calibration usually claims: a filter that is carried away claims
    more, and must not be excused by it.

    """

    needs = {"calibration": Replay}
    doubt: float = option(
        0.5, "chance of being elsewhere from which on the vehicle is lost", above=0, below=1
    )
    usual: np.ndarray = learned()  # () metres, deviation along an axis

    def fit(self, training: Training) -> Self:
        """Learn the field.

        Raises
        ------
        MapError
            There is no calibration, whose claims are what this tests.
        """
        whole = training.texton_map
        calibration = whole.parts.get("calibration") if whole is not None else None
        if not isinstance(calibration, Replay):
            raise MapError(
                "integrity tests what a calibration claims: train it with calibration=replay"
            )
        return super().fit(training).with_learned(usual=calibration.usual)

    def prepare(self) -> None:
        super().prepare()
        if self.usual is not None and not (self.usual.shape == () and 0 < self.usual < np.inf):
            raise ParameterError(
                f"the integrity's usual claim is {self.usual}: expected a positive length"
            )

    def open(self) -> Judge:
        return _Chain(self)

    def evidence(self, observation: Observation, estimate: Estimate) -> float:
        """Log of the frame's likelihood about the estimate over its mean anywhere."""
        found = self.over_cells(observation)
        shares = np.exp(found - found.max())
        claimed = estimate.about_position
        claimed = claimed * min(1.0, 2 * float(self.usual) ** 2 / float(np.trace(claimed)))
        inverse = np.linalg.inv(claimed + self.cell**2 / 12 * np.eye(2))
        offset = self.centers - estimate.position
        squared = np.einsum("ni,ij,nj->n", offset, inverse, offset)
        about = np.exp(-0.5 * (squared - squared.min()))
        return float(np.log(about @ shares / about.sum() / shares.mean() + 1e-300))


class _Chain:
    def __init__(self, test: Elsewhere):
        self._test = test
        self.reset()

    def reset(self) -> None:
        """Forget all frames; lost until some have spoken for the estimate."""
        self._elsewhere = 1 - CARRIED

    def judge(self, estimate: Estimate, observation: Observation | None) -> Estimate:
        if observation is not None:
            prior = (1 - RETURNED) * self._elsewhere + CARRIED * (1 - self._elsewhere)
            fits = (1 - ODD) * np.exp(self._test.evidence(observation, estimate)) + ODD
            self._elsewhere = float(prior / (prior + (1 - prior) * fits))
        return replace(estimate, lost=self._elsewhere > self._test.doubt)
