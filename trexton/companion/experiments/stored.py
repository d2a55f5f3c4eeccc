"""How the number of stored histograms sets the rate, far beyond the paper's 800.

Offers `time_stored`, which times search and step by brute force and by tree.
"""

from __future__ import annotations

from time import perf_counter
from typing import Any

import numpy as np

from trexton.base.progress import progress
from trexton.base.streams import stream
from trexton.companion.experiments.track import fly
from trexton.evaluation.runtime import frequency, milliseconds
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.neighbors import NearestHistograms

_FRAMES = 12  # timed for each number
_METHODS = ("brute", "tree")


def multiplied(
    histograms: np.ndarray, count: int, *, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    """``(count, K)`` histograms as if the floor had been flown over again and again, and the rows
    they copy.

    Each is one of the originals plus noise, in each texton as large as the change from frame to
    frame.
    """
    rows = rng.integers(len(histograms), size=count)
    deviation = np.diff(histograms, axis=0).std(axis=0)
    copies = histograms[rows]
    copies += rng.standard_normal(copies.shape) * deviation
    np.maximum(copies, 0, out=copies)
    copies /= np.maximum(copies.sum(axis=1, keepdims=True), 1e-12)
    return copies, rows


def time_stored(
    texton_map: TextonMap, frames: Any, *, samples: int, particles: int, most: int, seed: int
) -> tuple[list[Any], list[Any], float, dict[str, Any]]:
    """Time the search and the whole step on 100, 300, 1000 ... histograms, up to `most`.

    Returns
    -------
    rows, clocks : list of dict
        In one order: the number stored and whether both methods found the same; the times of both.
    agreement : float
        Share of searches in which brute force and tree found the same neighbours in the same order.
    ends : dict
        What the claims need of the shortest and the longest.
    """
    crowd, origin = multiplied(texton_map.histograms, most, rng=stream(seed, "stored"))
    rng = stream(seed, "queries")

    def localizer(**more: Any) -> Localizer:
        return Localizer(texton_map, rng=rng, samples=samples, particles=particles, **more)

    looking = localizer()
    asked = [looking.observe(frame) for frame in frames[:_FRAMES]]
    rows, clocks = [], []
    for count in progress(_numbers(most), "stored histograms"):
        clock: dict[str, Any] = {"stored": count}
        found = []
        for method in _METHODS:
            start = perf_counter()
            store = NearestHistograms(
                crowd[:count],
                texton_map.positions[origin[:count]],
                k=texton_map.neighbors,
                method=method,
            )
            built_s = perf_counter() - start
            step_ms = milliseconds([fly(localizer(nearest=store), frames[:_FRAMES]).step_s], 4)
            query_s, neighbors = zip(
                *(_timed(store, histogram) for histogram in asked), strict=False
            )
            found.append(np.array(neighbors))
            clock[method] = {
                "build_s": built_s, "query_ms": milliseconds([np.array(query_s)], 4),
                "frame_ms": step_ms, "frequency_hz": frequency(step_ms),
            }  # fmt: skip
        rows.append({"stored": count, "same": np.mean((found[0] == found[1]).all(axis=1))})
        clocks.append(clock)
    ends = {
        "knn_tree_ms": clocks[-1]["tree"]["query_ms"],
        "knn_brute_force_ms": clocks[-1]["brute"]["query_ms"],
        "frequency_fewest_histograms_hz": clocks[0]["brute"]["frequency_hz"],
        "frequency_most_histograms_hz": clocks[-1]["brute"]["frequency_hz"],
    }
    return rows, clocks, float(np.mean([row["same"] for row in rows])), ends


def _numbers(most: int) -> list[int]:
    """100, 300, 1000, ... and `most`."""
    return [*(n for power in range(2, 9) for n in (10**power, 3 * 10**power) if n < most), most]


def _timed(store: NearestHistograms, histogram: np.ndarray) -> tuple[float, np.ndarray]:
    start = perf_counter()
    index = store.query(histogram).index
    return perf_counter() - start, index
