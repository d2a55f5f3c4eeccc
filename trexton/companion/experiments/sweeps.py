"""What `trade_off` flies: one parameter varied, a grid of settings, ever more stored histograms.

A `Bench` holds the map and the decoded test flight that all of them share.
"""

import math
from functools import cached_property, partial
from itertools import product
from timeit import timeit
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from trexton.base.errors import MapError
from trexton.base.progress import progress
from trexton.base.streams import stream
from trexton.companion.checks.tuning import replayed_errors
from trexton.companion.executor import spread, working_on
from trexton.companion.experiments.declaration import MapParameters
from trexton.companion.experiments.evaluation import errors_of, flown, frames_of, map_of
from trexton.companion.experiments.metrics import summarize
from trexton.companion.experiments.rates import frequency, milliseconds
from trexton.companion.experiments.track import Track, fly, tracks
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.neighbors import NearestHistograms
from trexton.localization.training import with_choices
from trexton.vision.histograms import sampled_histogram, texton_histogram
from trexton.vision.images import position_grid

SWEPT: dict[str, tuple[Any, ...]] = {
    "samples": (25, 50, 100, 200, 400, 800, 1600, 3200, 6400, None),  # None: full sampling
    "particles": (5, 10, 25, 50, 100, 200, 400, 800),
}
_TIMED_FULL = 40  # frames are enough to time full sampling
_SLOW = {"samples": 1600, "particles": 400}  # beyond these a third of the runs will do
GRID = {"particles": (50, 400), "neighbors": (1, 3, 5, 10)}
_CHOSEN = ("samples", "particles", "neighbors")
STORED = (100, 300, 1000, 3000, 10_000, 30_000, 100_000, 300_000)
_TIMED_STORED = 12  # frames timed for each number of stored histograms


class TreeSearch(NearestHistograms):
    """The same search, its candidates by SciPy's k-d tree: the bits are the same."""

    def __init__(self, histograms: np.ndarray, positions: np.ndarray, k: int):
        super().__init__(histograms, positions, k)
        self._tree = cKDTree(histograms)

    def _candidates(self, query: np.ndarray, k: int) -> np.ndarray:
        reach = self._tree.query(query, [k])[0][0]
        near = self._tree.query_ball_point(query, reach * (1 + 1e-9), return_sorted=True)
        return np.array(near, dtype=np.int64)


class Sweep(NamedTuple):
    """One parameter's rows, its times in the same order, and the runs behind them by value."""

    rows: list[dict[str, Any]]
    clocks: list[dict[str, Any]]
    runs: dict[int | None, list[Track]]


class Bench:
    """A map and a test flight, its images decoded once."""

    def __init__(self, train: Flight, test: Flight, parameters: MapParameters, repeats: int):
        self.map, self.test, self.trained_on = map_of(train, parameters), test, len(train)
        self.quoted = flown(train, test, parameters, texton_map=self.map)  # of the defaults
        self.repeats, self.seed = repeats, parameters.seed
        self.defaults: dict[str, Any] = {name: getattr(parameters, name) for name in _CHOSEN}
        self.frames = frames_of(test)
        warm = Localizer(self.map, rng=stream(self.seed, "warm-up"))
        warm.step(self.frames[0])  # the first call loads what later ones need

    @cached_property
    def full(self) -> list[np.ndarray]:
        """The test frames' histograms of full sampling."""
        if not self.test.has_images:
            return list(self.frames)
        images = progress(self.frames, "full sampling")
        return [texton_histogram(image, self.map.alphabet) for image in images]

    @cached_property
    def wide(self) -> TextonMap:
        """The map with a measurement model for as many neighbours as are tried."""
        limit = max(self.map.neighbors, self.trained_on // 4)
        most = max(k for k in (*GRID["neighbors"], self.map.neighbors) if k <= limit)
        return with_choices(self.map, {"measurement.neighbors": most})

    def sweep(self, name: str) -> Sweep:
        """Vary `name`, the others at their defaults."""
        values = sorted({*SWEPT[name], self.defaults[name]}, key=lambda value: value or np.inf)
        result = Sweep([], [], {})
        for value in progress(values, f"varying {name}"):
            setting = self.defaults | {name: value}
            runs = self._runs(setting)
            judged = result.runs[value] = self.quoted if setting == self.defaults else runs
            errors = errors_of(judged, self.test, self.seed)
            full = setting["samples"] is None
            time_ms = milliseconds(self._full_times() if full else [run.step_s for run in runs])
            row = setting | {"patches": self._patches(setting), "runs": len(judged)}
            result.rows.append(row | {key: errors[key] for key in ("error_cm_x", "error_cm_y")})
            clock = {"frame_ms": time_ms, "frequency_hz": frequency(time_ms)}
            result.clocks.append(setting | clock)
        return result

    def errors(self, setting: dict[str, Any]) -> dict[str, Any]:
        """Statistics of several runs over the test flight, of patches drawn once for each run."""
        if setting == self.defaults:
            return errors_of(self.quoted, self.test, self.seed)
        options = {key: setting[key] for key in ("particles", "neighbors")}
        estimates = []
        for run in range(max(3, self.repeats // 3)):
            frames = self.full
            if setting["samples"] is not None:
                drawn = {"n": setting["samples"], "rng": stream(self.seed, "samples", run)}
                frames = [sampled_histogram(i, self.map.alphabet, **drawn) for i in self.frames]
            localizer = Localizer(self.wide, rng=stream(self.seed, "flight", run), **options)
            estimates.append(fly(localizer, frames).position)
        rng = stream(self.seed, "intervals")
        return summarize(estimates, self.test.position, self.test.diagonal, rng=rng, draws=400)

    def _runs(self, setting: dict[str, Any]) -> list[Track]:
        slow = any((setting[key] or 0) > most for key, most in _SLOW.items())
        repeats = max(3, self.repeats // 3) if slow else self.repeats
        frames = self.full if setting["samples"] is None else self.frames
        with working_on():  # timed: nothing runs beside
            return tracks(self.wide, frames, repeats=repeats, seed=self.seed, **setting)

    def _full_times(self) -> list[np.ndarray]:
        options = {key: self.defaults[key] for key in ("particles", "neighbors")}
        localizer = Localizer(self.wide, samples=None, rng=stream(self.seed, "warm-up"), **options)
        return [fly(localizer, self.frames[:_TIMED_FULL]).step_s]

    def _patches(self, setting: dict[str, Any]) -> int | None:
        """How many patches of an image are looked at; None where the flight came as histograms."""
        if not self.test.has_images:
            return None
        every = math.prod(position_grid(self.frames[0].shape, self.map.alphabet.patch))
        return setting["samples"] or every


def choose_setting(bench: Bench) -> tuple[list[dict[str, Any]], dict[str, Any]]:
    """Replay the training flight with a grid of settings, and fly the best over the test flight.

    Returns
    -------
    grid : list of dict
        Every setting, with the mean absolute error over both axes in its replay.
    tuned : dict
        ``tuned_setting``, ``tuned`` with its statistics over the test flight, and
        ``tuned_error_cm``, which is None where the training flight is too short to be replayed.
    """
    drawn = (bench.defaults["samples"], None) if bench.test.has_images else (None,)
    counts = [k for k in GRID["neighbors"] if k <= bench.wide.neighbors]
    grid = product(drawn, GRID["particles"], counts)
    settings = [dict(zip(_CHOSEN, chosen, strict=True)) for chosen in grid]
    replayed = spread(partial(_replayed, bench.wide, bench.seed), settings, "settings")
    errors = [error for error in replayed if error is not None]
    if len(errors) < len(settings):
        return [], {"tuned_error_cm": None}
    best = settings[int(np.argmin(errors))]
    tuned = bench.errors(best)
    rows = [row | {"replayed_cm": error} for row, error in zip(settings, errors, strict=True)]
    return rows, {"tuned": tuned, "tuned_error_cm": tuned["axis_mean_cm"], "tuned_setting": best}


def _replayed(texton_map: TextonMap, seed: int, setting: dict[str, Any]) -> float | None:
    """Error in the replay in cm, None where the training flight is too short."""
    choices = {
        "measurement.neighbors": setting["neighbors"],
        "filter.particles": setting["particles"],
    }
    try:
        tuned, rng = with_choices(texton_map, choices), stream(seed, "replay")
        errors = replayed_errors(tuned, samples=setting["samples"], rng=rng)
    except MapError:  # too short to leave parts of it out
        return None
    return 100 * float(np.abs(errors).mean())


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


def time_stored(bench: Bench, most: int) -> list[dict[str, Any]]:
    """Time the search and the whole step on 100, 300, 1000 ... histograms, up to `most`, one by one
    and by a tree.
    """
    crowd, origin = multiplied(bench.map.histograms, most, rng=stream(bench.seed, "stored"))
    places, rng = bench.map.positions[origin], stream(bench.seed, "queries")
    frames = bench.frames[:_TIMED_STORED]

    def localizer(**more: Any) -> Localizer:
        options = {key: bench.defaults[key] for key in ("samples", "particles")}
        return Localizer(bench.map, rng=rng, **options, **more)

    looking = localizer()
    asked = [looking.observe(frame) for frame in frames]
    clocks = []
    counts = [*(count for count in STORED if count < most), most]
    for count in progress(counts, "stored histograms"):
        clock: dict[str, Any] = {"stored": count}
        for method, search in (("brute", NearestHistograms), ("tree", TreeSearch)):
            store = search(crowd[:count], places[:count], k=bench.map.neighbors)
            step_ms = milliseconds([fly(localizer(nearest=store), frames).step_s], 4)
            query_s = [timeit(partial(store.query, one), number=1) for one in asked]
            query_ms = milliseconds([np.array(query_s)], 4)
            clock[method] = {"query_ms": query_ms, "frequency_hz": frequency(step_ms)}
        clocks.append(clock)
    return clocks
