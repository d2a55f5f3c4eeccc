"""What the stages work on: frames of the virtual room and a map of realistic size, all from one
seed.
"""

from __future__ import annotations

from functools import cached_property, partial
from typing import Any

import numpy as np

from trexton.base.streams import stream
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.measurement import RankMixture
from trexton.localization.methods import compose
from trexton.localization.motion import RandomWalk
from trexton.localization.neighbors import Neighbors
from trexton.localization.observation import Observation
from trexton.simulator import Simulator
from trexton.vision.histograms import texton_histogram
from trexton.vision.textons import TextonDictionary

__all__ = ["Scene", "crowd", "observations"]

_STORED = 800  # histograms in the paper's training set
_VIEWS = 48
_STEP = 0.08  # metres from frame to frame, a metre a second
_PERIOD = 0.08


def crowd(histograms: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """``(count, K)`` histograms between neighbours of a sequence, with the noise of counting 2000
    patches.
    """
    rows, share = rng.integers(len(histograms) - 1, size=count), rng.random((count, 1))
    mixed = histograms[rows] * (1 - share)
    mixed += histograms[rows + 1] * share
    mixed += rng.standard_normal(mixed.shape) * np.sqrt(mixed / 2000)
    np.maximum(mixed, 0, out=mixed)
    mixed /= mixed.sum(axis=1, keepdims=True)
    return mixed


def observations(positions: np.ndarray) -> list[Observation]:
    """Observations whose neighbours lie at these ``(N, k, 2)`` positions; as if a search had
    given them.
    """
    nothing = np.zeros(1)
    made = []
    for places in positions:
        index = np.arange(len(places))
        neighbors = Neighbors(index, index.astype(float), places)
        made.append(Observation(histogram=nothing.copy, neighbors=partial(_always, neighbors)))
    return made


def _always(neighbors: Neighbors, histogram: np.ndarray) -> Neighbors:
    return neighbors


class Scene:
    """Frames along a diagonal of the painted hall, and all that a stage may ask for, made when
    asked for.
    """

    def __init__(self, seed: int = 1):
        self.seed = seed

    def rng(self, name: str) -> np.random.Generator:
        return stream(self.seed, name)

    @cached_property
    def simulator(self) -> Simulator:
        """All effects on, at the paper's height and image size."""
        return Simulator(start=np.array([0.5, 0.5]), rng=self.rng("views"))

    @cached_property
    def views(self) -> tuple[list[np.ndarray], np.ndarray]:
        """Frames ``(480, 640, 3)`` and where each was taken, ``(N, 2)`` metres."""
        frames, positions = [], []
        for _ in range(_VIEWS):
            for _ in range(2):
                state = self.simulator.step(np.array([4.5, 4.5]))
            frames.append(self.simulator.render())
            positions.append(state.position[:2])
        return frames, np.array(positions)

    @property
    def frame(self) -> np.ndarray:
        return self.views[0][len(self.views[0]) // 2]

    @cached_property
    def dictionary(self) -> TextonDictionary:
        from trexton.vision.patches import draw_patches

        return TextonDictionary.learn(
            draw_patches(self.views[0], 6, 1000, self.rng("patches")), rng=self.rng("textons")
        )

    @cached_property
    def histograms(self) -> np.ndarray:
        """``(N, 20)`` full histograms of the frames."""
        return np.stack([texton_histogram(frame, self.dictionary) for frame in self.views[0]])

    @cached_property
    def map(self) -> TextonMap:
        """A map of 800 histograms."""
        rng = self.rng("map")
        spread = np.eye(2) * np.linspace(0.3, 0.5, 5)[:, None, None] ** 2
        return TextonMap(
            dictionary=self.dictionary,
            histograms=crowd(self.histograms, _STORED, rng),
            positions=rng.uniform(0, 5, (_STORED, 2)),
            time=_PERIOD * np.arange(_STORED),
            area=(0.0, 5.0, 0.0, 5.0),
            image_shape=self.frame.shape[:2],
            period_s=_PERIOD,
            method="paper",
            parts=compose("paper")
            | {
                "motion": RandomWalk.of(_STEP**2 * np.eye(2), _PERIOD),
                "measurement": RankMixture.of(spread),
            },
        )

    def localizer(self, **options: Any) -> Localizer:
        return Localizer(self.map, rng=self.rng("flight"), **options)
