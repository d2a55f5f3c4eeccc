"""How a belief is kept over time. The paper keeps particles (Sec. Filtering, Alg. 2).

Shapes, throughout: states are ``(M, D)``, positions ``(M, 2)`` metres; weights ``(M,)``, summing to
one; covariances ``(2, 2)``, square metres. Likelihoods are kept as logarithms.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Protocol

import numpy as np

from trexton.base.defaults import PARTICLES
from trexton.base.options import option
from trexton.localization.base import Area, Part
from trexton.localization.estimate import Estimate
from trexton.localization.measurement import MeasurementModel
from trexton.localization.motion import MotionModel
from trexton.localization.observation import Observation
from trexton.localization.particle_parts import (
    Belief,
    Estimation,
    MaximumAPosteriori,
    NoRecovery,
    Recovery,
    Resampling,
    Wheel,
)
from trexton.localization.texton_map import TextonMap

# Below this the plain weights would all be zero in double precision: no particle explains the
# measurement.
_VANISHED = np.log(np.finfo(float).tiny)


class RunningFilter(Protocol):
    """A filter in flight."""

    def reset(self) -> None:
        """Forget where the vehicle was."""

    def step(self, observation: Observation | None) -> object:
        """Advance one frame; None where nothing was observed: predict only."""

    def estimate(self) -> Estimate:
        """What is known after the latest step."""


class Filter(Part):
    """Base of all filters: a part that opens a `RunningFilter` for each localizer.

    It reads no other parts than those that it `needs` or `uses`. Every method has a motion model:
    where frames do not come, it says how uncertainty grows.
    """

    needs = {"motion": MotionModel}
    knows_velocity: ClassVar[bool] = False  # its estimates bear one
    knows_heading: ClassVar[bool] = False

    def open(
        self, parts: Mapping[str, Any], texton_map: TextonMap, rng: np.random.Generator
    ) -> RunningFilter:
        """A filter that knows nothing yet, made of the `parts` by role that it needs."""
        raise NotImplementedError


@dataclass(eq=False)
class Particles(Filter):
    """The paper's particle filter."""

    particles: int = option(PARTICLES, "M, their number", low=1, high=1_000_000)
    needs = {
        "motion": MotionModel,
        "measurement": MeasurementModel,
        "resampling": Resampling,
        "estimation": Estimation,
        "recovery": Recovery,
    }

    def open(
        self, parts: Mapping[str, Any], texton_map: TextonMap, rng: np.random.Generator
    ) -> ParticleFilter:
        chosen = {role: parts[role] for role in self.needs}
        return ParticleFilter(**chosen, area=texton_map.area, particles=self.particles, rng=rng)


class ParticleFilter:
    """Alg. 2 of the paper: predict, weigh, resample; and a point estimate from what it holds.

    Parameters
    ----------
    motion : MotionModel
    measurement : MeasurementModel
    area : (x_min, x_max, y_min, y_max)
        Where particles start, in metres.
    particles : int
        M, their number.
    resampling : Resampling, optional
    estimation : Estimation, optional
    recovery : Recovery, optional
        Replaces part of the particles when measurements stop fitting.
    rng : numpy.random.Generator

    Attributes
    ----------
    belief : Belief
        After the latest step; before the first, particles uniform over the area.
    previous : Belief or None
        Before that step, where there was one.
    """

    def __init__(
        self,
        motion: MotionModel,
        measurement: MeasurementModel,
        area: Area,
        particles: int = PARTICLES,
        *,
        resampling: Resampling | None = None,
        estimation: Estimation | None = None,
        recovery: Recovery | None = None,
        rng: np.random.Generator,
    ):
        self.size, self.area, self.rng = Particles(particles).particles, area, rng
        self.motion, self.measurement = motion, measurement
        self.resampling = resampling or Wheel()
        self.estimation = estimation or MaximumAPosteriori()
        self.recovery = copy.copy(recovery or NoRecovery())  # it keeps averages of its own
        self.reset()

    def reset(self) -> None:
        """Forget everything: particles uniform over the area."""
        weights = np.full(self.size, 1 / self.size)
        states = self.motion.start(self.rng, self.area, self.size)
        self.belief = Belief(states, weights, np.zeros(self.size))
        self.previous: Belief | None = None
        self.recovery.reset()

    def step(self, observation: Observation | None) -> Belief:
        """Advance one frame; None where nothing was observed: predict only."""
        if observation is not None:
            self.measurement.prepare_frame(observation)
        previous = self.belief
        if not np.isnan(previous.log_mean_likelihood):
            drawn = self.resampling.indices(previous.weights, self.rng)
            states = previous.states.take(drawn, axis=0)
        else:  # equal weights need no resampling, which would only lose particles
            states = previous.states.copy()
        self.recovery.inject(states, self.motion, self.area, self.rng)
        states = self.motion.sample(states, self.rng)
        self.previous = previous
        if observation is None:
            weights, flat = np.full(self.size, 1 / self.size), np.zeros(self.size)
            self.belief = Belief(states, weights, flat, lost=previous.lost)
        else:
            self._weigh(states, observation)
        return self.belief

    def _weigh(self, states: np.ndarray, observation: Observation) -> None:
        places = self.motion.position(states)
        log_likelihood = self.measurement.log_likelihood(places, observation)
        peak = log_likelihood.item(log_likelihood.argmax())
        if not peak > _VANISHED:  # also true for NaN
            self.reset()
            self.belief = replace(self.belief, lost=True)
            return
        weights = np.exp(log_likelihood - peak)
        total = np.add.reduce(weights)
        log_mean = float(peak + np.log(total / self.size))
        lost = self.recovery.update(log_mean)
        self.belief = Belief(states, weights / total, log_likelihood, log_mean, lost)

    def position(self) -> np.ndarray:
        """``(2,)`` point estimate in metres from the latest step."""
        return self.estimation.position(self.belief, self.previous, self.motion)

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Weighted mean ``(2,)`` and covariance ``(2, 2)`` of the particles."""
        places = self.motion.position(self.belief.states)
        mean = self.belief.weights @ places
        deviation = places - mean
        return mean, (deviation * self.belief.weights[:, None]).T @ deviation

    def estimate(self) -> Estimate:
        """Point estimate, covariance and particles of the latest step."""
        belief, (mean, covariance) = self.belief, self.moments()
        places = self.motion.position(belief.states)
        return Estimate(
            self.position().copy(), covariance, belief.lost, mean=mean, particles=places.copy(),
            weights=belief.weights.copy(),
        )  # fmt: skip
