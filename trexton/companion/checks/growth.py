"""How the cost grows with each size, and the exponent fitted to it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from itertools import cycle
from typing import Any

import numpy as np

from trexton.companion.checks.scene import Scene, crowd, observations
from trexton.companion.checks.timing import Row, Times, interleave
from trexton.companion.executor import limited_threads
from trexton.localization.filters import ParticleFilter
from trexton.localization.neighbors import NearestHistograms
from trexton.vision.histograms import sampled_histogram, texton_histogram
from trexton.vision.textons import TextonDictionary

__all__ = ["exponent", "growth"]


def growth(scene: Scene, quick: bool) -> Iterator[Row]:
    """Image size, textons, samples, particles, stored histograms; one thread, else the paper's
    defaults.
    """
    contests: tuple[tuple[str, tuple[int, ...], Callable[..., Any]], ...] = (
        ("pixels, full sampling", (160 * 120, 320 * 240, 640 * 480, 1280 * 960), _image),
        ("textons, full sampling", (8, 16, 32, 64, 128), _textons),
        ("samples", (50, 200, 800, 3200, 12_800), _samples),
        ("particles, filter and MAP", (25, 100, 400, 1600, 6400), _particles),
        ("stored histograms, tree", (1000, 10_000, 100_000, 1_000_000), _stored("tree")),
        ("stored histograms, in turn", (1000, 10_000, 100_000), _stored("brute")),
    )
    for what, sizes, make in contests:
        sizes = sizes[:-1] if quick else sizes
        rng = scene.rng("growth")
        with limited_threads(1):
            contestants = {size: make(scene, size, rng) for size in sizes}
            times = interleave(contestants, 0.1 if quick else 0.4, 5)
        yield from _fitted(what, times)


def exponent(sizes: Any, seconds: Any) -> tuple[float, float]:
    """Slope and constant of log time over log size, by least squares."""
    slope, constant = np.polyfit(np.log(sizes), np.log(seconds), 1)
    return float(slope), float(constant)


def _fitted(what: str, times: dict[int, Times]) -> Iterator[Row]:
    slope, constant = exponent(list(times), [each.median for each in times.values()])
    for size, each in times.items():
        fitted = float(np.exp(constant) * size**slope)
        yield Row.compare(f"growth, {what}", size, 1, each, f"fit, exponent {slope:.2f}", fitted)


def _image(scene: Scene, pixels: int, rng: np.random.Generator) -> Callable[..., Any]:
    height = round(np.sqrt(pixels * 3 / 4))
    image = np.resize(scene.frame, (height, pixels // height, 3))
    return lambda: texton_histogram(image, scene.dictionary, threads=1)


def _textons(scene: Scene, count: int, rng: np.random.Generator) -> Callable[..., Any]:
    dictionary = TextonDictionary(rng.integers(0, 256, (count, 6, 6, 3), dtype=np.uint8))
    return lambda: texton_histogram(scene.frame, dictionary, threads=1)


def _samples(scene: Scene, count: int, rng: np.random.Generator) -> Callable[..., Any]:
    return lambda: sampled_histogram(scene.frame, scene.dictionary, count, rng=rng)


def _particles(scene: Scene, count: int, rng: np.random.Generator) -> Callable[..., Any]:
    parts = scene.map.parts
    filter_ = ParticleFilter(parts["motion"], parts["measurement"], scene.map.area, count, rng=rng)
    seen = cycle(observations(2.5 + 0.4 * scene.rng("measurements").standard_normal((100, 5, 2))))

    def step() -> Any:
        filter_.step(next(seen))
        return filter_.position()

    return step


def _stored(method: str) -> Callable[..., Any]:
    def make(scene: Scene, count: int, rng: np.random.Generator) -> Callable[..., Any]:
        nearest = NearestHistograms(
            crowd(scene.histograms, count, rng), np.zeros((count, 2)), method=method
        )
        queries = iter(np.tile(crowd(scene.histograms, 200, rng), (100, 1)))
        return lambda: nearest.query(next(queries))

    return make
