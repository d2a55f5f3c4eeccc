"""What a particle filter leaves open: how the set is drawn anew, which one position it stands for,
and how it comes back when it was kidnapped.

The paper draws by a wheel, takes the maximum a posteriori, and has no recovery: from a place where
they have gathered its particles can only walk.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trexton.base.errors import ParameterError
from trexton.base.options import option
from trexton.localization.base import Area, Part
from trexton.localization.motion import MotionModel


class Resampling(Part):
    """Base of all resamplers."""

    def indices(self, weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """``(M,)`` indices of the particles that go on, for ``(M,)`` weights."""
        raise NotImplementedError


class Wheel(Resampling):
    """The resampling wheel the paper cites.

    The wheel starts at a random particle and advances by U(0, 2 max w) between draws. Walking it
    costs max w / mean w steps a particle; a search in the cumulated weights finds the same
    particles.
    """

    def indices(self, weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        count = len(weights)
        start = rng.integers(count)
        ends = weights.cumsum()
        around = ends.item(-1)
        places = rng.random(count).cumsum()
        places *= 2 * weights.item(weights.argmax())
        places += ends.item(start) - weights.item(start)
        places -= np.floor(places / around) * around
        drawn: np.ndarray = ends.searchsorted(places, side="left")
        return np.minimum(drawn, count - 1, out=drawn)


class Systematic(Resampling):
    """One random offset and equal steps: counts differ from M w by less than one."""

    def indices(self, weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        count = len(weights)
        ends = weights.cumsum()
        places = (np.arange(count) + rng.random()) / count * ends[-1]
        return np.minimum(ends.searchsorted(places, side="right"), count - 1)


@dataclass(frozen=True, eq=False, slots=True)
class Belief:
    """A particle set after one step, before resampling.

    Attributes
    ----------
    states : (M, D) array
        Of the motion model.
    weights : (M,) array, summing to one
    log_likelihood : (M,) array
        Zero where nothing was measured.
    log_mean_likelihood : float
        Of the measurement under the whole set; NaN where nothing was measured.
    lost : bool
        No particle explained the measurement, or the measurements have stopped fitting.
    """

    states: np.ndarray
    weights: np.ndarray
    log_likelihood: np.ndarray
    log_mean_likelihood: float = np.nan
    lost: bool = False


class Estimation(Part):
    """Base of all point estimates."""

    def position(self, belief: Belief, previous: Belief | None, motion: MotionModel) -> np.ndarray:
        """``(2,)`` metres, from this belief and the one before the motion."""
        raise NotImplementedError


class MaximumAPosteriori(Estimation):
    """argmax of p(z_t | x_i) sum_j p(x_i | x_j at t-1) w_j at t-1 (Driessen & Boers 2008)."""

    def position(self, belief: Belief, previous: Belief | None, motion: MotionModel) -> np.ndarray:
        if previous is None:
            row = int(np.argmax(belief.log_likelihood))
        else:
            row = motion.likeliest(
                belief.log_likelihood, belief.states, previous.states, previous.weights
            )
        return _place(belief, motion, row)


class WeightedMean(Estimation):
    """Weighted mean of the particles."""

    def position(self, belief: Belief, previous: Belief | None, motion: MotionModel) -> np.ndarray:
        return belief.weights @ motion.position(belief.states)


class HighestWeight(Estimation):
    """The particle of highest weight, the first where several share it."""

    def position(self, belief: Belief, previous: Belief | None, motion: MotionModel) -> np.ndarray:
        return _place(belief, motion, int(np.argmax(belief.weights)))


def _place(belief: Belief, motion: MotionModel, row: int) -> np.ndarray:
    return motion.position(belief.states[row : row + 1])[0]


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


class NoRecovery(Recovery):
    """The paper's: none."""


@dataclass(eq=False)
class Augmented(Recovery):
    """Inject random particles when the short-term likelihood of the measurements falls below the
    long-term one: augmented Monte Carlo localization (Thrun, Burgard & Fox 2005, Sec. 8.3.3).

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
