"""Recovery from being carried away: augmented Monte Carlo localization (Thrun, Burgard & Fox 2005,
Sec. 8.3.3).

Not part of the paper's filter, which cannot leave a place where its particles have gathered.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trexton.base.errors import ParameterError
from trexton.base.options import option
from trexton.localization.base import Area, Part
from trexton.localization.motion import MotionModel

__all__ = ["Augmented", "NoRecovery", "Recovery"]


@dataclass(eq=False)
class Recovery(Part):
    """Base of all recoveries: watches how well measurements fit, and replaces particles."""

    def reset(self) -> None:
        """Forget what was seen."""

    def update(self, log_mean_likelihood: float) -> bool:
        """Take in one frame's mean likelihood; returns whether the vehicle counts as lost."""
        return False

    def inject(
        self, states: np.ndarray, motion: MotionModel, area: Area, rng: np.random.Generator
    ) -> None:
        """Replace some of the states in place."""


@dataclass(eq=False)
class NoRecovery(Recovery):
    """The paper's: none."""


@dataclass(eq=False)
class Augmented(Recovery):
    """Inject random particles when the short-term likelihood of the measurements falls below the
    long-term one.

    The likelihoods are averaged exponentially, fast and slowly.
    """

    slow: float = option(0.01, "rate of the slow average, a frame", above=0, high=1)
    fast: float = option(0.2, "rate of the fast average, a frame", above=0, high=1)
    lost_below: float = option(0.5, "lost while fast over slow average is less", low=0, high=1)

    def check(self) -> None:
        if self.slow >= self.fast:
            raise ParameterError(f"slow is {self.slow}: expected less than fast, {self.fast}")
        self.reset()

    def reset(self) -> None:
        self._slow_mean = self._fast_mean = 0.0
        self._seen = 0

    @property
    def fitness(self) -> float:
        """Short-term over long-term average likelihood; 1 before anything was measured."""
        return self._fast_mean / self._slow_mean if self._slow_mean > 0 else 1.0

    def update(self, log_mean_likelihood: float) -> bool:
        likelihood = float(np.exp(log_mean_likelihood))
        self._seen += 1
        # Plain means until enough frames were seen, or the first one, with particles everywhere,
        # would weigh too much.
        self._slow_mean += max(self.slow, 1 / self._seen) * (likelihood - self._slow_mean)
        self._fast_mean += max(self.fast, 1 / self._seen) * (likelihood - self._fast_mean)
        return self.fitness < self.lost_below

    def inject(
        self, states: np.ndarray, motion: MotionModel, area: Area, rng: np.random.Generator
    ) -> None:
        """Replace each state, with probability 1 - `fitness`, by one from anywhere; in place."""
        probability = max(0.0, 1.0 - self.fitness)
        replaced = rng.random(len(states)) < probability
        states[replaced] = motion.start(rng, area, int(replaced.sum()))
