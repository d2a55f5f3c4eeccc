"""Speed of every stage as a ratio to a yardstick of the same run.

Offers `measure`, which gives a row for each contest of the `STAGES`. They work on a flight of the
virtual room and on maps trained from it.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from functools import cache, cached_property, partial
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import ParameterError
from trexton.base.progress import say
from trexton.base.streams import stream
from trexton.companion.checks.timing import Contest, Row
from trexton.companion.executor import environment
from trexton.companion.experiments.evaluation import evenly_spread
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.map_files import save_map
from trexton.localization.training import train_map
from trexton.vision.histograms import sampled_histogram, texton_histogram
from trexton.vision.images import position_grid

__all__ = ["STAGES", "Scene", "measure"]

Contests = Iterator[Contest]

_GEMM = 2048
_SIZE = "640x480"
_VIEWS = 48  # frames that are looked at, evenly over the flight
_PARTICLES = ((50, 0.5, 1), (500, 0.04, 1), (5000, 0.02, 2))  # how many, limit, threads


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
        self.map = cache(self.train)  # by method

    @cached_property
    def flight(self) -> Flight:
        from trexton.simulator import record_flight

        frames = 200 if self.quick else 800
        return record_flight(self.folder / "flight", frames=frames, seed=self.seed)

    @cached_property
    def rows(self) -> np.ndarray:
        return evenly_spread(len(self.flight), _VIEWS)

    @cached_property
    def views(self) -> list[np.ndarray]:
        """``(480, 640, 3)`` frames."""
        return [self.flight.image(row) for row in self.rows]

    def train(self, method: str) -> TextonMap:
        return train_map(self.flight, method=method, rng=stream(self.seed, "training"))


def train(scene: Scene) -> Contests:
    """A map of the flight, on two threads, against decoding its images once."""
    flight = scene.flight
    decoding = "decoding the images", lambda: list(flight.images())
    for method, limit in (("paper", 4.0), ("field", 5.0)):
        ours = f"train {method}", f"{len(flight)} frames", partial(_anew, scene, method)
        yield Contest(*ours, *decoding, limit, threads=2, rounds=3)


def _anew(scene: Scene, method: str) -> TextonMap:
    """A map for which nothing was counted before, in an earlier round or for another method."""
    with (
        tempfile.TemporaryDirectory() as folder,
        environment({"TREXTON_CACHE": folder}),
    ):
        return scene.train(method)


def histogram(scene: Scene) -> Contests:
    """Every patch of a frame labelled against sgemm; and 400 patches against all of them."""
    dictionary, rng, view = (
        scene.map("paper").alphabet,
        stream(scene.seed, "samples"),
        scene.views[0],
    )
    square = rng.random((_GEMM, _GEMM), dtype=np.float32)
    # 1.303e9 multiplications and additions for 20 textons of 6x6x3.
    positions = np.prod(position_grid(view.shape, dictionary.patch))
    share = 2.0 * positions * dictionary.textons.size / (2.0 * _GEMM**3)
    full = partial(texton_histogram, view, dictionary)
    for threads, limit in ((1, 1 / 1.15), (2, 1 / 0.9)):
        sgemm = "sgemm's rate", lambda: square @ square
        yield Contest("full histogram", _SIZE, full, *sgemm, limit, threads, float(share))
    sampled = partial(sampled_histogram, view, dictionary, 400, rng=rng)
    yield Contest("sampled histogram", 400, sampled, "full histogram", full)


def neighbors(scene: Scene) -> Contests:
    """The nearest of N histograms against SciPy's k-d tree."""
    from scipy.spatial import cKDTree

    from trexton.localization.neighbors import NearestHistograms

    rng = stream(scene.seed, "stored")
    for count, limit in ((800, 1.2), (10_000, None), (100_000, None)):  # the latter by a tree too
        stored, queries = (
            _crowd(scene.map("paper").histograms, number, rng) for number in (count, 200)
        )
        ours = _each(NearestHistograms(stored, np.zeros((count, 2)), 5).query, queries)
        theirs = _each(partial(cKDTree(stored).query, k=5), queries)
        yield Contest("neighbours", count, ours, "SciPy cKDTree", theirs, limit)


def _each(call: Callable[..., object], items: Iterable[Any]) -> Callable[[], object]:
    """A call of the next item, round and round."""
    turn = cycle(items)
    return lambda: call(next(turn))


def _crowd(histograms: np.ndarray, count: int, rng: np.random.Generator) -> np.ndarray:
    """``(count, K)`` histograms of 2000 patches each, between neighbours of a sequence."""
    rows, share = rng.integers(len(histograms) - 1, size=count), rng.random((count, 1))
    mixed = histograms[rows] * (1 - share) + histograms[rows + 1] * share
    return rng.multinomial(2000, mixed / mixed.sum(axis=1, keepdims=True)) / 2000


def filter_step(scene: Scene) -> Contests:
    """One step of the filter with its MAP estimate against `einsum`."""
    motion = scene.map("paper").parts["motion"]
    precision = np.linalg.inv(motion.growth(scene.map("paper").period_s))
    for count, limit, threads in _PARTICLES:
        localizer = Localizer(scene.map("paper"), particles=count, rng=stream(scene.seed, "filter"))
        seen = [localizer.observation(each) for each in scene.map("paper").histograms[:100]]
        for each in seen:
            each.neighbors  # noqa: B018 - found now, not while the filter is timed
            localizer.advance(each)
        filter_: Any = localizer.filter
        now, before = filter_.belief, filter_.previous
        inputs = now.states, now.log_likelihood, before.states, before.weights, precision
        step = _each(lambda one, own=filter_: (own.step(one), own.position()), seen)
        einsum = "einsum, MAP alone", partial(_map_by_einsum, *inputs)
        yield Contest("filter step", count, step, *einsum, limit, threads)


def _map_by_einsum(
    particles: np.ndarray, log_likelihood: Any, previous: Any, weights: Any, precision: Any
) -> np.ndarray:
    density = np.empty(len(particles))
    for first in range(0, len(particles), 100):
        difference = particles[first : first + 100, None] - previous
        squared = np.einsum("ija,ab,ijb->ij", difference, precision, difference)
        density[first : first + 100] = np.exp(-0.5 * squared) @ weights
    return particles[np.argmax(log_likelihood + np.log(density + 1e-300))]


def frame(scene: Scene) -> Contests:
    """Image in, estimate out against one SIFT of the frame; and the homography at half size."""
    import cv2

    from trexton.registration.homography import KEYPOINTS, HomographyLocalizer

    floor = scene.flight.floor
    assert floor is not None  # the simulator knows it
    whole, half = (HomographyLocalizer(floor, scale=scale) for scale in (1.0, 0.5))
    detector = cv2.SIFT.create(nfeatures=KEYPOINTS)
    lumas = [view[..., 0].copy() for view in scene.views]
    sift = "SIFT of the frame", _each(lambda luma: detector.detectAndCompute(luma, None), lumas)
    frames = list(zip(scene.views, map(scene.flight.aiding, scene.rows), strict=True))
    for method in ("paper", "field", "fine"):
        one = Localizer(scene.map(method), rng=stream(scene.seed, "flight"))
        step = _each(lambda both, one=one: one.step(both[0], aiding=both[1]), frames)
        yield Contest(f"frame, {method}", _SIZE, step, *sift)
    locate = _each(whole.locate, scene.views)
    yield Contest("frame, homography", _SIZE, locate, *sift, 1.4)
    smaller = _each(half.locate, scene.views)
    yield Contest("frame, homography, half size", _SIZE, smaller, "homography", locate, 1 / 3)


_FIRST_FRAME = """
import sys
import numpy as np
from trexton.localization.localizer import Localizer
from trexton.localization.map_files import load_map
localizer = Localizer(load_map(sys.argv[1]), rng=np.random.default_rng(1))
assert localizer.step(np.load(sys.argv[2])[0]).observed
"""


def start(scene: Scene) -> Contests:
    """The command's help, and a process from nothing to its first estimate, with the caches of
    kernels and bytecode warm.
    """
    help_ = partial(_python, scene, "from trexton.cli.main import main; main(['--help'])")
    bare = "import NumPy and OpenCV", partial(_python, scene, "import numpy, cv2")
    yield Contest("start, trexton --help", "process", help_, *bare, 1.0)
    yield Contest(
        "start, first frame", "process", partial(_python, scene, _FIRST_FRAME), *bare, 1.2
    )


def _python(scene: Scene, program: str) -> None:
    """Run a program that is given a map and pictures."""
    texton_map, pictures = scene.folder / "map.npz", scene.folder / "pictures.npy"
    if not pictures.exists():
        save_map(scene.map("paper"), texton_map)
        np.save(pictures, np.stack(scene.views[:1]))
    # An environment without bytecode would have every source compiled anew: its own cache.
    environment = {
        name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"
    } | {"PYTHONPYCACHEPREFIX": str(scene.folder / "bytecode")}
    command = [sys.executable, "-c", program, str(texton_map), str(pictures)]
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, env=environment)


STAGES: dict[str, Callable[[Scene], Contests]] = {
    "train": train,
    "histogram": histogram,
    "neighbors": neighbors,
    "filter": filter_step,
    "frame": frame,
    "start": start,
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

    Raises `ParameterError` where a stage is unknown.
    """
    stages = list(STAGES) if stages is None else list(stages)
    for name in stages:
        if name not in STAGES:
            raise ParameterError(f"stage {name!r} is unknown: the stages are {', '.join(STAGES)}")
    with tempfile.TemporaryDirectory() as folder:
        scene = Scene(Path(folder), quick, seed)
        for name in stages:
            say(f"bench: {name}")
            yield from (contest.row(quick) for contest in STAGES[name](scene))
