"""Error against the CPU time of a frame, over painted floors: methods and peers on equal frames.

``make frontier`` writes ``data/reference/frontier.json``, which the page of the trade-offs draws.
The time is that of one thread from a decoded image to a position. Keypoints are searched in every
fifth frame, on the true picture of the floor; where they give no position, the last one stands.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from time import process_time
from typing import Any

import cv2
import numpy as np
import pandas as pd

from trexton.base.defaults import SAMPLES
from trexton.base.files import write_file
from trexton.base.progress import say
from trexton.base.streams import stream
from trexton.companion.executor import limited_threads
from trexton.companion.experiments import baselines
from trexton.companion.experiments.floors import mean_over_floors, painted_floor
from trexton.companion.experiments.homography import HomographyLocalizer
from trexton.companion.experiments.metrics import euclidean
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer
from trexton.localization.methods import make
from trexton.localization.training import for_method, full_histograms, train_map, with_parts
from trexton.registration.homography import find_homography
from trexton.simulator.floor import Floor
from trexton.simulator.recording import record_flight
from trexton.vision.camera import MapImage, transform_points
from trexton.vision.histograms import sampled_histogram

OUT = Path(__file__).resolve().parents[1] / "data" / "reference"
FLOORS, FIRST_FLOOR = 10, 1400  # seed of the first painted floor; nothing was chosen on these
SURVEY, FRAMES, EVERY_OTHER = 400, 200, 2
CELLS = 2  # parts of the image a side for the field
EVERY, WARM = 5, 5  # of keypoints one frame in so many; frames that load kernels are not timed
PAPER: dict[str, tuple[str, dict[str, Any]]] = {  # choices of its filter
    "paper_few": ("50 samples", {"samples": 50}),
    "paper": ("the paper's filter", {}),
    "paper_500": ("500 particles", {"particles": 500}),
    "paper_all": ("every patch", {"samples": None}),
    "paper_5000": ("5,000 particles", {"particles": 5000}),
}
LABELS = {name: label for name, (label, _) in PAPER.items()} | {
    "hmm": "hidden Markov model",
    "forest": "smoothed random forest",
    "field": "field",
    "field_odometry": "field and odometry",
    "fine": "fine",
    "homography": "SIFT",
    "homography_half": "SIFT, half size",
    "homography_orb": "ORB",
}
Step = Callable[[np.ndarray], np.ndarray]  # from an image to a place, NaN where it finds none
Finish = Callable[[np.ndarray], np.ndarray]  # of all places


def methods(survey: Flight, rng: np.random.Generator) -> Iterator[tuple[str, Step, Finish]]:
    """Each method, trained on a survey."""
    base = train_map(survey, rng=rng)
    cut = base.with_histograms(full_histograms(survey, base.alphabet, CELLS), CELLS)
    field = for_method(cut, "field", flight=survey, rng=rng)
    odometry = with_parts(field, {"odometry": make("odometry", "visual")}, flight=survey)
    localizers = {name: Localizer(base, rng=rng, **chosen) for name, (_, chosen) in PAPER.items()}
    localizers |= {
        "hmm": Localizer(base, "hmm", rng=rng),
        "field": Localizer(field, rng=rng),
        "field_odometry": Localizer(odometry, rng=rng),
        "fine": Localizer(for_method(base, "fine", flight=survey, rng=rng), rng=rng),
    }
    for name, localizer in localizers.items():
        yield name, lambda image, own=localizer: own.step(image).position, np.asarray
    grown = partial(baselines._forest, 40, 1)
    predict, alpha = baselines._chosen(grown, [2], field, rng)

    def by_forest(image: np.ndarray) -> np.ndarray:
        seen = sampled_histogram(image, field.alphabet, SAMPLES, rng=rng, cells=CELLS)
        return predict(seen[None])[0]

    yield "forest", by_forest, partial(baselines._smoothed, alpha=alpha)
    for name, scale in (("homography", 1.0), ("homography_half", 0.5)):
        yield name, HomographyLocalizer(survey.floor, scale=scale).locate, held
    yield "homography_orb", by_orb(survey.floor), held


def held(places: np.ndarray) -> np.ndarray:
    """Where none was found, the last one before."""
    return pd.DataFrame(places).ffill().bfill().to_numpy()


def by_orb(floor: MapImage) -> Step:
    """The homography of ORB keypoints, whose bits FLANN searches by locality-sensitive hashing."""
    luma = cv2.cvtColor(floor.image, cv2.COLOR_BGR2GRAY)
    detected, bits = cv2.ORB.create(30_000).detectAndCompute(luma, None)
    points = np.array([each.pt for each in detected])
    hashing = {"algorithm": 6, "table_number": 6, "key_size": 12, "multi_probe_level": 1}
    index = cv2.flann.Index(bits, hashing, 9)  # 9: Hamming's distance
    detector = cv2.ORB.create(1000)

    def locate(image: np.ndarray) -> np.ndarray:
        detected, bits = detector.detectAndCompute(np.ascontiguousarray(image[..., 0]), None)
        if not detected:
            return np.full(2, np.nan)
        nearest, apart = index.knnSearch(bits, 2)
        good = apart[:, 0] < 0.8 * apart[:, 1]
        source = np.array([each.pt for each in detected])[good]
        homography, _ = find_homography(source, points[nearest[good, 0]], 5.0)
        if homography is None:
            return np.full(2, np.nan)
        rows, columns = image.shape[:2]
        center = transform_points(homography, [[(columns - 1) / 2, (rows - 1) / 2]])
        return floor.to_world(center)[0]

    return locate


def over(floor: Floor, seed: int, survey: int, frames: int) -> dict[str, tuple[np.ndarray, float]]:
    """Of each method over one floor: errors in cm, and mean CPU milliseconds of a frame."""
    common: dict[str, Any] = {"floor": floor, "every": EVERY_OTHER}
    with tempfile.TemporaryDirectory() as folder:
        known = record_flight(Path(folder) / "survey", frames=survey, seed=seed, **common)
        later = record_flight(
            Path(folder) / "later", pattern="waypoints", frames=frames, seed=seed + 1, **common
        )
        flown, images = {}, list(later.images())
        for name, step, finish in methods(known, stream(seed, "frontier")):
            rows = slice(0, None, EVERY if name.startswith("homography") else 1)
            places, clock = [], [process_time()]
            for image in images[rows]:
                places.append(step(image))
                clock.append(process_time())
            errors_cm = 100 * euclidean(finish(np.array(places)), later.position[rows])
            flown[name] = errors_cm, 1000 * float(np.diff(clock)[WARM:].mean())
    return flown


def measure(floors: int, survey: int, frames: int) -> Any:
    """The record of all floors; it is that of another run of the baselines."""
    flown = []
    with limited_threads(1):
        for index in range(floors):
            name, floor = painted_floor(index, FIRST_FLOOR + index)
            say(f"floor {name}")
            flown.append(over(floor, 1000 * (index + 1), survey, frames))
    rng = stream(1, "intervals")
    values: dict[str, Any] = {"floors": floors, "frames": frames, "survey": survey} | {
        name: {"mean_cm": mean_over_floors(np.stack([each[name][0] for each in flown]), rng)}
        for name in LABELS
    }
    step_ms = {name: float(np.mean([each[name][1] for each in flown])) for name in LABELS}
    lent = Flight("painted-floors", np.arange(1), np.zeros(1), np.zeros((1, 2)), (0, 1, 0, 1),
                  histograms=np.ones((1, 1)))  # fmt: skip
    return baselines.Parameters().record(
        lent, values=values | {"labels": LABELS}, timings={"step_ms": step_ms}
    )


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as folder:
        made = measure(FLOORS, SURVEY, FRAMES).save(Path(folder))
        write_file(OUT / "frontier.json", made.read_text(encoding="utf-8"))
    sys.exit()
