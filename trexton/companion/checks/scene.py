"""What the bench works on: a flight of the virtual room and maps trained from it, from one seed.

Offers `Scene`, which makes each when a stage asks for it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from pathlib import Path

import numpy as np

from trexton.base.streams import stream
from trexton.companion.checks.timing import interleave
from trexton.companion.executor import limited_threads
from trexton.flights.flight import Flight
from trexton.localization.texton_map import TextonMap
from trexton.localization.training import train_map

__all__ = ["Scene"]

_VIEWS = 48  # frames that are looked at, evenly over the flight


class Scene:
    """A survey of the painted hall and all that a stage may ask for, made when asked for.

    Parameters
    ----------
    folder : Path
        Where the flight is written.
    quick : bool
        200 frames instead of 800, and less of everything that is measured.
    seed : int
    """

    def __init__(self, folder: Path, quick: bool = False, seed: int = 1):
        self.folder, self.quick, self.seed = folder, quick, seed
        self._maps: dict[str, TextonMap] = {}

    def rng(self, name: str) -> np.random.Generator:
        return stream(self.seed, name)

    def times(
        self,
        contestants: Mapping[str, Callable[[], object]],
        threads: int = 1,
        seconds: float = 1.0,
    ) -> dict[str, np.ndarray]:
        """Seconds of contestants on so many threads, in so many seconds each."""
        with limited_threads(threads):
            share, rounds = (0.3, 3) if self.quick else (1.0, 9)
            return interleave(contestants, share * seconds, rounds)

    @cached_property
    def flight(self) -> Flight:
        from trexton.simulator import record_flight

        frames = 200 if self.quick else 800
        return record_flight(self.folder / "flight", frames=frames, seed=self.seed)

    @cached_property
    def rows(self) -> np.ndarray:
        return np.linspace(0, len(self.flight) - 1, _VIEWS).astype(int)

    @cached_property
    def views(self) -> list[np.ndarray]:
        """``(480, 640, 3)`` frames."""
        return [self.flight.image(row) for row in self.rows]

    def map(self, method: str = "paper") -> TextonMap:
        if method not in self._maps:
            self._maps[method] = self.train(method)
        return self._maps[method]

    def train(self, method: str) -> TextonMap:
        return train_map(self.flight, method=method, rng=self.rng("training"))
