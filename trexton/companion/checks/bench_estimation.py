"""Stages that follow the histogram: neighbours, filter, the whole frame; and growth with size.

Offers the stages, each a generator of rows beside its yardsticks.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from itertools import cycle
from typing import Any

import numpy as np

from trexton.base.progress import say
from trexton.companion.checks.scene import Scene, crowd, observations
from trexton.companion.checks.timing import Row, Times, interleave
from trexton.companion.executor import limited_threads
from trexton.companion.wording import duration
from trexton.evaluation.runtime import StageTimer
from trexton.localization.filters import ParticleFilter
from trexton.localization.neighbors import NearestHistograms
from trexton.onboard.status import resident_bytes
from trexton.vision.histograms import sampled_histogram, texton_histogram
from trexton.vision.textons import TextonDictionary

__all__ = ["exponent", "filter_step", "growth", "neighbors", "whole_frame"]

_K = 5


def neighbors(scene: Scene, quick: bool) -> Iterator[Row]:
    """k nearest of N histograms against brute force in NumPy, SciPy's k-d tree and scikit-learn."""
    from scipy.spatial import cKDTree
    from sklearn.neighbors import NearestNeighbors

    rng = scene.rng("stored")
    for count in (800, 10_000, 100_000) if quick else (800, 10_000, 100_000, 1_000_000):
        table, queries = crowd(scene.histograms, count, rng), crowd(scene.histograms, 200, rng)
        nearest, tree = NearestHistograms(table, np.zeros((count, 2)), _K), cKDTree(table)
        learned = NearestNeighbors(n_neighbors=_K).fit(table)
        turn = iter(np.tile(np.arange(len(queries)), 10_000))
        contestants = {
            "ours": lambda: nearest.query(queries[next(turn)]),
            "NumPy brute force": lambda: _by_numpy(table, queries[next(turn)]),
            "SciPy cKDTree": lambda: tree.query(queries[next(turn)], _K),
            "scikit-learn": lambda: learned.kneighbors(queries[next(turn)][None]),
        }
        with limited_threads(1):
            times = interleave(contestants, 0.2 if quick else 0.6)
        for name in list(contestants)[1:]:
            yield Row.compare("neighbours", count, 1, times["ours"], name, times[name], 1.2)


def _by_numpy(table: np.ndarray, query: np.ndarray) -> np.ndarray:
    distance = np.linalg.norm(table - query, axis=1)
    near = np.argpartition(distance, _K)[:_K]
    return near[np.argsort(distance[near])]


def filter_step(scene: Scene, quick: bool) -> Iterator[Row]:
    """One step of the filter with its MAP estimate against `einsum`."""
    motion, mixture = scene.map.parts["motion"], scene.map.parts["measurement"]
    precision = np.linalg.inv(motion.growth(scene.map.period_s))
    for count, limit, threads in ((50, 0.5, 1), (500, 0.04, 1), (5000, 0.02, 2)):
        rng = scene.rng("measurements")
        filter_ = ParticleFilter(motion, mixture, scene.map.area, count, rng=scene.rng("filter"))
        measurements = cycle(observations(2.5 + 0.4 * rng.standard_normal((100, _K, 2))))

        def ours() -> Any:
            filter_.step(next(measurements))
            return filter_.position()

        ours()
        ours()
        now, before = filter_.belief, filter_.previous
        assert before is not None  # two steps were made
        inputs = (now.states, now.log_likelihood, before.states, before.weights, precision)
        contestants = {"ours": ours, "einsum": lambda: _map_by_einsum(*inputs)}
        with limited_threads(threads):
            times = interleave(contestants, 0.3 if quick else 1.0, 3 if quick else 9)
        yield Row.compare(
            "filter step",
            count,
            threads,
            times["ours"],
            "einsum, MAP alone",
            times["einsum"],
            limit,
        )


def _map_by_einsum(
    particles: np.ndarray, log_likelihood: Any, previous: Any, weights: Any, precision: Any
) -> np.ndarray:
    density = np.empty(len(particles))
    for first in range(0, len(particles), 100):
        difference = particles[first : first + 100, None] - previous
        squared = np.einsum("ija,ab,ijb->ij", difference, precision, difference)
        density[first : first + 100] = np.exp(-0.5 * squared) @ weights
    return particles[np.argmax(log_likelihood + np.log(density + 1e-300))]


def whole_frame(scene: Scene, quick: bool) -> Iterator[Row]:
    """Image in, estimate out at the paper's defaults, against the sum of its stages; then many
    frames.
    """
    whole, frames = scene.localizer(), scene.views[0]
    parts = StageTimer(scene.map, rng=scene.rng("flight"))
    turn = iter(np.tile(np.arange(len(frames)), 100_000))
    contestants = {
        "frame": lambda: whole.step(frames[next(turn)]),
        "stages": lambda: parts.step(frames[next(turn)]),
    }
    with limited_threads(1):
        times = interleave(contestants, 0.5 if quick else 2.0, 15)
        count = 5_000 if quick else 100_000
        say(f"bench: {count} frames")
        seconds, resident = _many_frames(whole, frames, count)
    name, size, stages = "whole frame", "defaults", parts.medians()
    shares = ", ".join(f"{part} {duration(median)}" for part, median in stages.items())
    yield Row.compare(
        name, size, 1, times["frame"], "sum of its stages", sum(stages.values()), 1.15, shares
    )
    long = Times.of(seconds)
    p99 = Times(long.p99, long.p99, long.repeats)
    yield Row.compare(f"{name}, p99", size, 1, p99, "twice the median", 2 * long.median, 1.0)
    first, last = (Times.of(part) for part in (seconds[: count // 10], seconds[-count // 10 :]))
    grown = f"{(resident[1] - resident[0]) / 2**20:+.1f} MiB"
    tenth = f"{name}, last tenth of {count}"
    yield Row.compare(tenth, size, 1, last, "first tenth", first, 1.1, f"memory {grown}")


def _many_frames(localizer: Any, frames: Any, count: int) -> tuple[np.ndarray, tuple[int, int]]:
    """Seconds of each of `count` frames, and the resident bytes after the first tenth and at the
    end.
    """
    seconds, before = np.empty(count), 0
    for index in range(count):
        frame = frames[index % len(frames)]
        start = time.perf_counter()
        localizer.step(frame)
        seconds[index] = time.perf_counter() - start
        if index == count // 10:
            before = resident_bytes()
    return seconds, (before, resident_bytes())


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
    measurements = cycle(
        observations(2.5 + 0.4 * scene.rng("measurements").standard_normal((100, 5, 2)))
    )

    def step() -> Any:
        filter_.step(next(measurements))
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
