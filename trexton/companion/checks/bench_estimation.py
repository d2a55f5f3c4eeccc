"""Stages that follow the histogram: neighbours, filter, and the frame as a whole."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator
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

__all__ = ["filter_step", "neighbors", "whole_frame"]

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
    """One step of the filter with its MAP estimate against `einsum` and a plain double sum."""
    motion, mixture = scene.map.parts["motion"], scene.map.parts["measurement"]
    precision = np.linalg.inv(motion.growth(scene.map.period_s))
    for count, limit, threads in ((50, 0.5, 1), (500, 0.04, 1), (5000, 0.02, 2)):
        rng = scene.rng("measurements")
        filter_ = ParticleFilter(motion, mixture, scene.map.area, count, rng=scene.rng("filter"))
        seen = cycle(observations(2.5 + 0.4 * rng.standard_normal((100, _K, 2))))

        def ours() -> Any:
            filter_.step(next(seen))
            return filter_.position()

        ours()
        ours()
        now, before = filter_.belief, filter_.previous
        assert before is not None  # two steps were made
        inputs = (now.states, now.log_likelihood, before.states, before.weights, precision)
        contestants = {"ours": ours, "einsum": lambda: _map_by_einsum(*inputs)}
        if count <= 500:
            contestants["double sum"] = lambda: _map_by_sums(*inputs)
        with limited_threads(threads):
            times = interleave(contestants, 0.3 if quick else 1.0, 3 if quick else 9)
        for name, asked in (("einsum", limit), ("double sum", None)):
            if name in times:
                other = f"{name}, MAP alone"
                yield Row.compare(
                    "filter step", count, threads, times["ours"], other, times[name], asked
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


def _map_by_sums(
    particles: np.ndarray, log_likelihood: Any, previous: Any, weights: Any, precision: Any
) -> np.ndarray:
    (a, b), (_, d) = precision.tolist()
    best, place = -np.inf, 0
    known = list(zip(previous.tolist(), weights.tolist(), strict=False))
    for i, (x, y) in enumerate(particles.tolist()):
        total = 1e-300
        for (u, v), weight in known:
            dx, dy = x - u, y - v
            total += weight * np.e ** (-0.5 * (a * dx * dx + 2 * b * dx * dy + d * dy * dy))
        score = log_likelihood[i] + np.log(total)
        if score > best:
            best, place = score, i
    return particles[place]


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
            before = _resident_bytes()
    return seconds, (before, _resident_bytes())


def _resident_bytes() -> int:
    try:
        with open("/proc/self/statm") as stream:
            return int(stream.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0
