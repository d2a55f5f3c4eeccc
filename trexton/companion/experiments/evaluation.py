"""What several experiments share. A map is trained, frames are flown, tracks are measured."""

from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np

from trexton.base.cache import cached
from trexton.base.progress import progress
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import MapParameters
from trexton.companion.experiments.metrics import (
    block_rows,
    euclidean,
    mean_with_interval,
    summarize,
    with_interval,
)
from trexton.companion.experiments.track import ARRAYS, Track, tracks
from trexton.flights.flight import Flight
from trexton.localization.localizer import TextonMap
from trexton.localization.map_files import from_arrays, to_arrays
from trexton.localization.training import for_method, train_map
from trexton.vision.camera import MapImage
from trexton.vision.histograms import sampled_histogram

RUNS = {"paper": 20, "field": 1}  # one where no more is drawn than the patches
MOST_LAG_FRAMES = 60


def map_of(
    train: Flight, parameters: MapParameters, positions: np.ndarray | None = None
) -> TextonMap:
    """The texton map of `train`, from the cache if the same inputs were used before."""
    options: dict[str, Any] = {"n_textons": parameters.textons, "neighbors": parameters.neighbors}
    inputs = {"flight": train.data_hash, "seed": parameters.seed, **options}
    if positions is not None:
        inputs["positions"] = [[float(value).hex() for value in row] for row in positions]

    def compute() -> Any:
        rng = stream(parameters.seed, "training")
        return to_arrays(train_map(train, rng=rng, positions=positions, **options))

    return from_arrays(cached("map", "trexton.localization.localizer", inputs, compute))


def flown(
    train: Flight,
    test: Flight,
    parameters: MapParameters,
    method: str = "paper",
    *,
    repeats: int | None = None,
    texton_map: TextonMap | None = None,
) -> list[Track]:
    """The runs of a method over the test flight that every page quotes: flown once, then cached.

    Parameters
    ----------
    repeats : int, optional
        Independent runs, by default `RUNS`; run i draws from stream ``"flight", i``.
    texton_map : TextonMap, optional
        The method's map where it is at hand; else it is trained.
    """
    repeats = RUNS[method] if repeats is None else repeats
    options: dict[str, Any] = {"samples": parameters.samples}
    if method == "paper":
        options["particles"] = parameters.particles

    def compute() -> dict[str, np.ndarray]:
        chosen = texton_map or method_map(train, parameters, method)
        how: dict[str, Any] = {"seed": parameters.seed, "times": test.time, "label": method}
        runs = tracks(chosen, frames_of(test), repeats=repeats, **how, **options)
        return {name: np.stack([getattr(run, name) for run in runs]) for name in ARRAYS}

    inputs = {"train": train.data_hash, "test": test.data_hash, "method": method, **options}
    inputs |= {"textons": parameters.textons, "neighbors": parameters.neighbors}
    inputs |= {"seed": parameters.seed, "repeats": repeats}
    arrays = cached("flown", __name__, inputs, compute)
    return [Track(*(arrays[name][run] for name in ARRAYS)) for run in range(repeats)]


def method_map(train: Flight, parameters: MapParameters, method: str) -> TextonMap:
    """The map of a method, of the same dictionary and frames as the paper's."""
    rng, located = stream(parameters.seed, "calibration"), train.select(train.located)
    return for_method(map_of(train, parameters), method, flight=located, rng=rng)


def errors_of(runs: Sequence[Track], test: Flight, seed: int) -> dict[str, Any]:
    """What `summarize` gives of runs; the same wherever it is asked."""
    rng, positions = stream(seed, "intervals"), [run.position for run in runs]
    return summarize(positions, test.position, test.diagonal, rng=rng)


def coverage(runs: Sequence[Track], test: Flight, seed: int) -> dict[str, float]:
    """The share of frames whose 90 % region holds the truth, with its 95 % interval."""
    held = np.stack([run.held(test.position) for run in runs])
    return mean_with_interval(held, stream(seed, "intervals"))


def lag(runs: Sequence[Track], test: Flight) -> dict[str, float]:
    """By how much the estimates trail: the shift in time under which they fit the truth best."""
    shifts = range(min(MOST_LAG_FRAMES, len(test) // 4))
    errors = [
        np.mean([euclidean(run.position[n:], test.position[: len(test) - n]) for run in runs])
        for n in shifts
    ]
    best = int(np.argmin(errors))
    period = (test.time[-1] - test.time[0]) / max(1, len(test) - 1)
    error, unshifted = 100 * errors[best], 100 * errors[0]
    return {"s": best * period, "error_cm": error, "unshifted_cm": unshifted}


def frames_of(flight: Flight) -> Sequence[np.ndarray]:
    """What the localizer takes, one a frame: the images where there are any, else the
    histograms.
    """
    if flight.has_images:
        return list(flight.images())
    assert flight.histograms is not None  # a flight has one or the other
    return list(flight.histograms)


def evenly_spread(count: int, most: int) -> np.ndarray:
    """Rows of at most `most` of `count` frames, evenly spread from the first to the last."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(int))


def drawn_histograms(test: Flight, texton_map: TextonMap, samples: int, seed: int) -> np.ndarray:
    """``(N, K)`` one drawn for each frame, so that several runs see the same, and maps of images in
    other parts the same patches; as they are where the flight came as histograms.
    """
    if test.histograms is not None and not test.has_images:
        return test.histograms
    rng, dictionary = stream(seed, "samples"), texton_map.alphabet
    images = progress(test.images(), "histograms", len(test))
    return np.stack(
        [
            sampled_histogram(image, dictionary, samples, rng=rng, cells=texton_map.cells)
            for image in images
        ]
    )


def drift(runs: list[Track], test: Flight, *, rng: np.random.Generator) -> dict[str, Any]:
    """Slope of the Euclidean error over time in cm a minute, with its 95 % interval: does the error
    accumulate?
    """
    minutes = (test.time - test.time[0]) / 60
    error_cm = [100 * run.errors(test.position) for run in runs]

    def slope(run: int, rows: np.ndarray) -> float:
        return float(np.polyfit(minutes[rows], error_cm[run][rows], 1)[0])

    drawn = [slope(int(rng.integers(len(runs))), block_rows(len(test), rng)) for _ in range(500)]
    median = np.median([slope(run, np.arange(len(test))) for run in range(len(runs))])
    return with_interval(median, drawn, len(test))


def whereabouts(train: Flight) -> dict[str, Any]:
    """What puts the tracks of a record in its place: ``height_m`` at which the map was flown, and
    ``origin_deg`` on Earth; what is not known is left out.
    """
    place: dict[str, Any] = {} if train.origin is None else {"origin_deg": train.origin}
    if train.height is not None and np.isfinite(train.height).any():
        place["height_m"] = float(np.nanmedian(train.height))
    return place


def map_picture(picture: MapImage, width: int) -> tuple[dict[str, Any], np.ndarray]:
    """A picture of the floor as figures draw it: its extent (a series), and a copy `width` pixels
    wide; what is not mapped is white.
    """
    image = picture.image
    if picture.mask is not None:
        image = np.where(picture.mask[..., None], image, 255).astype(np.uint8)
    rows, columns = image.shape[:2]
    (left, top), _, (right, bottom), _ = picture.corners
    small = cv2.resize(image, (width, round(width * rows / columns)), interpolation=cv2.INTER_AREA)
    return {"extent_m": [left, right, bottom, top]}, small


def floor_picture(flight: Flight) -> tuple[dict[str, Any], dict[str, Any]]:
    """The true floor as figures draw it, a series and a picture; both empty where unknown."""
    if flight.floor is None:
        return {}, {}
    extent, picture = map_picture(flight.floor, 700)
    return {"floor": extent}, {"floor": picture}


def constant_guess(train: np.ndarray, count: int) -> np.ndarray:
    """``(count, 2)`` the mean training position: the baseline that knows nothing but the area."""
    return np.tile(np.nanmean(train, axis=0), (count, 1))


def shuffled_neighbors(
    positions: np.ndarray, count: int, k: int, *, rng: np.random.Generator
) -> np.ndarray:
    """``(count, 2)`` means of k random training positions: the k-NN with shuffled histograms."""
    return positions[rng.integers(len(positions), size=(count, k))].mean(axis=1)
