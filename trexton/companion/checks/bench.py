"""Speed of every stage as a ratio to a yardstick of the same run.

Offers `measure`, which gives a row for each contest of the `STAGES`, and `measure_board`. They work
on a flight of the virtual room and on maps trained from it.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from importlib.metadata import version
from itertools import cycle
from pathlib import Path
from subprocess import PIPE
from typing import Any

import cv2
import numpy as np

from trexton.base.errors import ParameterError
from trexton.base.progress import say
from trexton.base.streams import stream
from trexton.companion.checks.timing import VIEWS, Contest, Row, Scene
from trexton.companion.checks.waiting import answers, learning
from trexton.companion.executor import environment
from trexton.companion.experiments.homography import KEYPOINTS, HomographyLocalizer
from trexton.companion.provenance import machine
from trexton.localization.localizer import Localizer, TextonMap
from trexton.localization.map_files import save_map
from trexton.vision.histograms import texton_histogram
from trexton.vision.images import position_grid

Contests = Iterator[Contest]

_GEMM = 2048
_SIZE = "640x480"
_ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENCV_FOR_THREADS_NUM"), "1")
_PARTICLES = ((50, 0.5, 1), (500, 0.04, 1), (5000, 0.01, 2))  # how many, limit, threads
_ALL = "roll", "pitch", "yaw", "height"
# Method, what the autopilot measures, and limit.
_FRAMES: tuple[tuple[str, tuple[str, ...], float | None], ...] = (
    ("paper", _ALL, None),
    ("field", _ALL, None),
    ("fine", _ALL, 0.06),
    ("fine, tilt found", _ALL[2:], 0.09),
)


def train(scene: Scene) -> Contests:
    """A map of the flight, on two threads, against decoding its images once."""
    for method, limit in (("paper", 4.0), ("field", 5.0)):
        ours = partial(_anew, scene, method)
        yield scene.contest(f"train {method}", ours, limit, threads=2, rounds=3)


def _anew(scene: Scene, method: str) -> TextonMap:
    """A map for which nothing was counted before, in an earlier round or for another method."""
    with tempfile.TemporaryDirectory() as folder, environment({"TREXTON_CACHE": folder}):
        return scene.train(method)


def histogram(scene: Scene) -> Contests:
    """Every patch of a frame labelled against sgemm."""
    dictionary, view = scene.map("paper").alphabet, scene.views[0]
    square = stream(scene.seed, "samples").random((_GEMM, _GEMM), dtype=np.float32)
    # 1.303e9 multiplications and additions for 20 textons of 6x6x3.
    positions = np.prod(position_grid(view.shape, dictionary.patch))
    share = 2.0 * positions * dictionary.textons.size / (2.0 * _GEMM**3)
    full = partial(texton_histogram, view, dictionary)
    for threads, limit in ((1, 1 / 1.15), (2, 1 / 0.9)):
        sgemm = "sgemm's rate", lambda: square @ square
        yield Contest("full histogram", _SIZE, full, *sgemm, limit, threads, float(share))


def _each(call: Callable[..., object], items: Iterable[Any]) -> Callable[[], object]:
    """A call of the next item, round and round."""
    turn = cycle(items)
    return lambda: call(next(turn))


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
    floor = scene.flight.floor
    assert floor is not None  # the simulator knows it
    whole, half = (HomographyLocalizer(floor, scale=scale) for scale in (1.0, 0.5))
    detector = cv2.SIFT.create(nfeatures=KEYPOINTS)
    lumas = [view[..., 0].copy() for view in scene.views]
    sift = "SIFT of the frame", _each(lambda luma: detector.detectAndCompute(luma, None), lumas)
    # There and back: where a frame is not beside the last one, a vehicle was kidnapped.
    *back, last = range(len(scene.flight))[-VIEWS:]
    images = {row: scene.flight.image(row) for row in (*back, last)}
    for method, known, limit in _FRAMES:
        one = Localizer(scene.map(method.partition(",")[0]), rng=stream(scene.seed, "flight"))
        frames = [
            (images[row], scene.flight.aiding(row).only(known))
            for row in (*back, last, *back[:0:-1])
        ]
        step = _each(lambda both, one=one: one.step(both[0], aiding=both[1]), frames)
        yield Contest(f"frame, {method}", _SIZE, step, *sift, limit)
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
    first = partial(_python, scene, _FIRST_FRAME)
    yield Contest("start, first frame", "process", first, *bare, 1.15)


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
    "filter": filter_step,
    "frame": frame,
    "start": start,
    "learning": learning,
    "answers": answers,
}
LONG = ("learning", "answers")  # of some minutes each, measured where they are named


def measure(
    stages: Iterable[str] | None = None, *, quick: bool = False, seed: int = 1
) -> Iterator[Row]:
    """Measure stages one after another: keys of `STAGES` (else `ParameterError`), or all but the
    `LONG`, in some minutes; `quick`, by fewer repeats and frames, in about one.
    """
    stages = [name for name in STAGES if name not in LONG] if stages is None else list(stages)
    for name in stages:
        if name not in STAGES:
            raise ParameterError(f"stage {name!r} is unknown: the stages are {', '.join(STAGES)}")
    with tempfile.TemporaryDirectory() as folder:
        scene = Scene(Path(folder), 200 if quick else 800, seed)
        for name in stages:
            say(f"bench: {name}")
            yield from (contest.row(quick) for contest in STAGES[name](scene))


def measure_board(frames: int = 600, method: str = "field", seed: int = 1) -> dict[str, Any]:
    """How fast this computer flies: a line for the table of boards.

    The onboard script, as a program of its own, flies `frames` of 640x480 pixels from files:
    reading a camera comes on top. Median and 99th percentile of the latency in milliseconds, memory
    in MiB, seconds from the start of the program to its first position with the kernels compiled.
    """
    with tempfile.TemporaryDirectory() as folder:
        scene = Scene(Path(folder), frames, seed)
        words = ["onboard", str(save_map(scene.train(method), Path(folder) / "map.npz"))]
        words += ["--camera", f"{folder}/flight", "--output", "json"]
        _flown([*words, "--frames", "2"])  # a first start compiles
        first_s, summary = _flown(words)
    latency = summary["latency_s"]
    return {
        "machine": machine(),
        "version": version("trexton"),
        "method": method,
        "frames": summary["frames"],
        "latency_ms": {"p50": 1e3 * latency["median"], "p99": 1e3 * latency["p99"]},
        "memory_mib": summary["memory_bytes"] / 2**20,
        "first_position_s": first_s,
    }


def _flown(words: list[str]) -> tuple[float, dict[str, Any]]:
    """Seconds to the first position of the script, and its summary."""
    began = time.monotonic()
    command, env = [sys.executable, "-m", "trexton", *words], os.environ | _ONE_THREAD
    script = subprocess.Popen(command, stdout=PIPE, stderr=PIPE, text=True, env=env)
    assert script.stdout is not None
    script.stdout.readline()
    first_s = time.monotonic() - began
    _, said = script.communicate()
    if script.returncode:
        raise subprocess.CalledProcessError(script.returncode, words, stderr=said)
    summary: dict[str, Any] = json.loads(said.splitlines()[-1].partition(": ")[2])
    return first_s, summary
