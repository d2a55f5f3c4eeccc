"""Speed of every stage as a ratio to a yardstick of the same run, interleaved in one process.

Offers `measure`, which gives a row for each of the `STAGES`.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import ParameterError
from trexton.base.progress import say
from trexton.companion.checks.processes import onboard, start
from trexton.companion.checks.scene import Scene
from trexton.companion.checks.timing import Row, row
from trexton.companion.wording import duration
from trexton.localization.localizer import Localizer
from trexton.vision.histograms import sampled_histogram, texton_histogram
from trexton.vision.patches import position_grid

__all__ = ["STAGES", "measure"]

_GEMM = 2048
_CORRECT_M = 0.3  # metres within which a fix counts as right
_SIZE = "640x480"
_PARTICLES = ((50, 0.5, 1), (500, 0.04, 1), (5000, 0.02, 2))  # how many, limit, threads
_METHODS = ("paper", "field", "fine")


def train(scene: Scene) -> Iterator[Row]:
    """A map of the flight, on two threads, against decoding its images once on one."""
    flight = scene.flight

    decoding = scene.times({"decoding": lambda: list(flight.images())}, seconds=0)["decoding"]
    for method, limit in (("paper", 4.0), ("field", 5.0)):
        ours = scene.times({method: lambda: scene.train(method)}, threads=2, seconds=0)[method]
        size = f"{len(flight)} frames"
        yield row(f"train {method}", size, 2, ours, "decoding the images", decoding, limit)


def histogram(scene: Scene) -> Iterator[Row]:
    """Every patch of a frame labelled against sgemm; and 400 patches against all of them."""
    dictionary, rng, view = scene.map().alphabet, scene.rng("samples"), scene.views[0]
    square = rng.random((_GEMM, _GEMM), dtype=np.float32)
    # 1.303e9 multiplications and additions for 20 textons of 6x6x3.
    operations = (
        2.0 * np.prod(position_grid(view.shape, dictionary.patch)) * dictionary.textons.size
    )
    contestants: dict[str, Callable[[], object]] = {
        "sgemm": lambda: square @ square,
        "full": lambda: texton_histogram(view, dictionary),
        "sampled": lambda: sampled_histogram(view, dictionary, 400, rng=rng),
    }
    for threads, limit in ((1, 1 / 1.15), (2, 1 / 0.9)):
        times = scene.times(contestants, threads, seconds=2.0)
        rate = "sgemm's rate", times["sgemm"] * operations / (2.0 * _GEMM**3)
        yield row("full histogram", _SIZE, threads, times["full"], *rate, limit)
        if threads == 1:
            full = "full histogram", times["full"]
            yield row("sampled histogram", "400", 1, times["sampled"], *full)


def neighbors(scene: Scene) -> Iterator[Row]:
    """The nearest of N histograms against SciPy's k-d tree."""
    from scipy.spatial import cKDTree

    from trexton.localization.neighbors import NearestHistograms

    rng = scene.rng("stored")
    for count in (800, 10_000, 100_000):
        stored, queries = (_crowd(scene.map().histograms, number, rng) for number in (count, 200))
        nearest, tree = NearestHistograms(stored, np.zeros((count, 2)), 5), cKDTree(stored)
        turn = cycle(queries)
        times = scene.times({
            "ours": lambda: nearest.query(next(turn)), "tree": lambda: tree.query(next(turn), 5)
        })  # fmt: skip
        yield row("neighbours", count, 1, times["ours"], "SciPy cKDTree", times["tree"], 1.2)


def _crowd(histograms: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """``(count, K)`` histograms between neighbours of a sequence, with the noise of counting 2000
    patches.
    """
    rows, share = rng.integers(len(histograms) - 1, size=count), rng.random((count, 1))
    mixed = histograms[rows] * (1 - share) + histograms[rows + 1] * share
    mixed = np.maximum(mixed + rng.standard_normal(mixed.shape) * np.sqrt(mixed / 2000), 0)
    return mixed / mixed.sum(axis=1, keepdims=True)


def filter_step(scene: Scene) -> Iterator[Row]:
    """One step of the filter with its MAP estimate against `einsum`."""
    motion = scene.map().parts["motion"]
    precision = np.linalg.inv(motion.growth(scene.map().period_s))
    for count, limit, threads in _PARTICLES:
        localizer = Localizer(scene.map(), particles=count, rng=scene.rng("filter"))
        seen = [localizer.observation(each) for each in scene.map().histograms[:100]]
        for each in seen:
            each.neighbors  # noqa: B018 - found now, not while the filter is timed
            localizer.advance(each)
        filter_: Any = localizer.filter
        now, before, turn = filter_.belief, filter_.previous, cycle(seen)
        inputs = now.states, now.log_likelihood, before.states, before.weights, precision
        contestants: dict[str, Callable[[], object]] = {
            "ours": lambda: (filter_.step(next(turn)), filter_.position()),
            "einsum": lambda: _map_by_einsum(*inputs),
        }
        times = scene.times(contestants, threads)
        yardstick = "einsum, MAP alone", times["einsum"]
        yield row("filter step", count, threads, times["ours"], *yardstick, limit)


def _map_by_einsum(
    particles: np.ndarray, log_likelihood: Any, previous: Any, weights: Any, precision: Any
) -> np.ndarray:
    density = np.empty(len(particles))
    for first in range(0, len(particles), 100):
        difference = particles[first : first + 100, None] - previous
        squared = np.einsum("ija,ab,ijb->ij", difference, precision, difference)
        density[first : first + 100] = np.exp(-0.5 * squared) @ weights
    return particles[np.argmax(log_likelihood + np.log(density + 1e-300))]


def frame(scene: Scene) -> Iterator[Row]:
    """Image in, estimate out: the paper's method against the sum of its stages, others against one
    SIFT of the frame; and the homography method, at whole and at half size.
    """
    import cv2

    from trexton.evaluation.runtime import StageTimer
    from trexton.registration.homography import HomographyLocalizer

    assert scene.flight.floor is not None  # the simulator knows it
    located = {
        name: HomographyLocalizer(scene.flight.floor, scale=scale)
        for name, scale in (("homography", 1.0), ("homography, half size", 0.5))
    }
    sift = cv2.SIFT.create(nfeatures=located["homography"].keypoints)
    stages = StageTimer(scene.map(), rng=scene.rng("flight"))
    flown = {name: Localizer(scene.map(name), rng=scene.rng("flight")) for name in _METHODS}
    turn = cycle(zip(scene.views, map(scene.flight.aiding, scene.rows), strict=True))
    calls: dict[str, Callable[..., object]] = {
        "SIFT of the frame": lambda view, _: sift.detectAndCompute(view[..., 0].copy(), None),
        "stages": lambda view, _: stages.step(view),
    }
    for name, one in flown.items():
        calls[name] = lambda view, aiding, one=one: one.step(view, aiding=aiding)
    for name, each in located.items():
        calls[name] = lambda view, _, each=each: each.locate(view)
    contestants = {name: partial(_on_next, call, turn) for name, call in calls.items()}
    times = scene.times(contestants, seconds=3.0)
    medians = stages.medians()
    shares = ", ".join(f"{part} {duration(seconds)}" for part, seconds in medians.items())
    total = sum(medians.values())
    yield row("frame, paper", _SIZE, 1, times["paper"], "sum of its stages", total, 1.15, shares)
    yardstick = "SIFT of the frame", times["SIFT of the frame"]
    for name in _METHODS[1:]:
        yield row(f"frame, {name}", _SIZE, 1, times[name], *yardstick)
    whole = "homography", times["homography"]
    for name, against, limit in (
        ("homography", yardstick, 1.4), ("homography, half size", whole, 1 / 3),
    ):  # fmt: skip
        found = np.array([located[name].locate(view).position for view in scene.views])
        apart = np.hypot(*(found - scene.flight.position[scene.rows]).T)
        note = f"right within {_CORRECT_M} m: {np.mean(apart < _CORRECT_M):.0%}"
        yield row(f"frame, {name}", _SIZE, 1, times[name], *against, limit, note)


def _on_next(call: Callable[..., object], turn: Iterator[Any]) -> object:
    return call(*next(turn))


STAGES: dict[str, Callable[[Scene], Iterator[Row]]] = {
    "train": train,
    "histogram": histogram,
    "neighbors": neighbors,
    "filter": filter_step,
    "frame": frame,
    "start": start,
    "onboard": onboard,
}


def measure(
    stages: Iterable[str] | None = None, *, quick: bool = False, seed: int = 1
) -> Iterator[Row]:
    """Measure stages one after another; all of them take some minutes.

    Parameters
    ----------
    stages : iterable of str or None
        Keys of `STAGES`; None is all.
    quick : bool
        Fewer repeats and frames: about a minute.
    seed : int
        Of the flight and the maps.

    Raises
    ------
    ParameterError
        A stage is unknown.
    """
    stages = list(STAGES) if stages is None else list(stages)
    for name in stages:
        if name not in STAGES:
            raise ParameterError(f"stage {name!r} is unknown: the stages are {', '.join(STAGES)}")
    with tempfile.TemporaryDirectory() as folder:
        scene = Scene(Path(folder), quick, seed)
        for name in stages:
            say(f"bench: {name}")
            yield from STAGES[name](scene)
