"""Recovery from being carried away: augmented Monte Carlo localization (Thrun, Burgard & Fox 2005, Sec. 8.3.3).

Not part of the paper's filter, which cannot leave a place where its particles have gathered; off by default.
"""

from __future__ import annotations

import numpy as np

from trexton.errors import ParameterError

__all__ = ["AugmentedRecovery", "make_recovery"]


class AugmentedRecovery:
    """Inject random particles when the short-term likelihood of the measurements falls below the long-term one.

    Parameters
    ----------
    slow, fast : float
        Rates of the two exponential averages, 0 < slow < fast <= 1, a frame.
    lost_below : float
        The vehicle counts as lost while fast average / slow average is below this.
    """

    def __init__(self, slow: float = 0.01, fast: float = 0.2, lost_below: float = 0.5):
        if not 0 < slow < fast <= 1:
            raise ParameterError(
                f"recovery rates are slow {slow}, fast {fast}: expected 0 < slow < fast <= 1"
            )
        self.slow, self.fast, self.lost_below = slow, fast, lost_below
        self.reset()

    def reset(self) -> None:
        """Forget the averages."""
        self._slow_mean = self._fast_mean = 0.0
        self._seen = 0

    @property
    def fit(self) -> float:
        """Short-term over long-term average likelihood; 1 before anything was measured."""
        return self._fast_mean / self._slow_mean if self._slow_mean > 0 else 1.0

    def update(self, log_mean_likelihood: float) -> bool:
        """Take in one frame's mean likelihood; returns whether the vehicle counts as lost."""
        likelihood = float(np.exp(log_mean_likelihood))
        self._seen += 1
        # Plain means until enough frames were seen, or the first one, with particles everywhere, would weigh too much.
        self._slow_mean += max(self.slow, 1 / self._seen) * (likelihood - self._slow_mean)
        self._fast_mean += max(self.fast, 1 / self._seen) * (likelihood - self._fast_mean)
        return self.fit < self.lost_below

    def inject(self, particles: np.ndarray, particle_filter) -> None:
        """Replace each particle, with probability 1 - `fit`, by one drawn uniformly over the area; in place."""
        probability = max(0.0, 1.0 - self.fit)
        replaced = particle_filter.rng.random(len(particles)) < probability
        particles[replaced] = particle_filter.uniform(int(replaced.sum()))


def make_recovery(name: str | None) -> AugmentedRecovery | None:
    """The recovery called `name`: None for the paper's filter, "augmented" for random particles."""
    if name is None or name == "none":
        return None
    if name == "augmented":
        return AugmentedRecovery()
    raise ParameterError(f"recovery {name!r} is unknown: choose none or augmented")
