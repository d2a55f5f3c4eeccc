"""A particle set is drawn anew in proportion to its weights. Offers systematic resampling and the
paper's wheel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trexton.localization.base import Part

__all__ = ["Resampling", "Systematic", "Wheel"]


@dataclass(eq=False)
class Resampling(Part):
    """Base of all resamplers."""

    def indices(self, weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """``(M,)`` indices of the particles that go on, for ``(M,)`` weights."""
        raise NotImplementedError


@dataclass(eq=False)
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


@dataclass(eq=False)
class Systematic(Resampling):
    """One random offset and equal steps: counts differ from M w by less than one."""

    def indices(self, weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        count = len(weights)
        ends = weights.cumsum()
        places = (np.arange(count) + rng.random()) / count * ends[-1]
        return np.minimum(ends.searchsorted(places, side="right"), count - 1)
