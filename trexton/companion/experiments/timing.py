"""Time for one frame (paper, Analysis, "Speed versus Accuracy Trade-Off"; Discussion). Every stage
is timed for itself.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from time import perf_counter
from timeit import timeit
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.progress import progress
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.executor import limited_threads
from trexton.companion.experiments.declaration import POSITIONS, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import frames_of, map_of
from trexton.companion.experiments.homography import HomographyLocalizer
from trexton.companion.experiments.printed import look_up, published
from trexton.companion.experiments.rates import frequency, milliseconds
from trexton.companion.experiments.style import COLORS, canvas
from trexton.companion.experiments.track import fly
from trexton.companion.provenance import machine
from trexton.companion.wording import number, percent
from trexton.companion.wording import times as so_often
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer
from trexton.vision.camera import MapImage


@dataclass(frozen=True)
class Parameters(MapParameters):
    """What can be chosen."""

    passes: int = option(3, "flights flown; a frame's time is the median of its passes", low=1)
    full_frames: int = option(60, "frames for full sampling", low=1)
    homography_frames: int = option(20, "frames for the homography", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Time each stage of the localizer over the test flight, full sampling, a homography; images
    are decoded. The localizer has one thread: libraries that share a frame among several wait for
    one another where other programs want a processor too.

    With images, or with histograms; then there is no histogram to time, and no homography.
    """
    texton_map, frames = map_of(train, parameters), frames_of(test)
    options: dict[str, Any] = {"samples": parameters.samples, "particles": parameters.particles}

    def localizer(**changes: Any) -> Localizer:
        return Localizer(texton_map, rng=stream(parameters.seed, "flight", 0), **options | changes)

    timings: dict[str, Any] = {"machine": machine()}
    totals, stages = [], []
    with limited_threads(1):
        fly(localizer(), frames[:2])  # whatever the first calls load
        for _ in progress(range(parameters.passes), "timing the flight"):
            totals.append(fly(localizer(), frames).step_s)
            stages.append(stage_seconds(localizer, frames))
        if test.has_images:
            step_s = fly(localizer(samples=None), frames[: parameters.full_frames]).step_s
            timings["full_sampling_ms"] = _distribution(step_s)
            timings["full_sampling_hz"] = frequency(milliseconds([step_s]))
    total_s = np.median(totals, axis=0)
    stages_s = {name: np.median([each[name] for each in stages], axis=0) for name in stages[0]}
    rest_s = np.sum([stages_s[name] for name in stages_s if name != "histogram"], axis=0)
    timings |= {
        "total_ms": _distribution(total_s),
        "frequency_hz": frequency(milliseconds([total_s])),
        "stages_ms": {
            name: _distribution(seconds) for name, seconds in (stages_s | {"rest": rest_s}).items()
        },
    }
    if test.has_images:
        medians = {name: np.median(seconds) for name, seconds in stages_s.items()}
        timings["histogram_share"] = float(medians["histogram"] / sum(medians.values()))
    if test.has_images and test.floor is not None:
        timings["homography_ms"] = _homography(
            test.floor, frames[:: max(1, len(frames) // parameters.homography_frames)]
        )
    values = {
        "counts": {"train": len(texton_map.positions), "test": len(test)},
        "camera_hz": 1 / np.median(np.diff(test.time)),
    }
    return parameters.record(train, test, values=values, timings=timings)


def stage_seconds(localizer: Callable[..., Localizer], frames: Any) -> dict[str, np.ndarray]:
    """Of each stage of a localizer that ran, in the order of `step`, what every frame took."""
    seconds: dict[str, list[float]] = {}
    last = 0.0

    def mark(stage: str) -> None:
        nonlocal last
        now = perf_counter()
        seconds.setdefault(stage, []).append(now - last)
        last = now

    timed = localizer(mark=mark)
    for frame in frames:
        last = perf_counter()
        timed.step(frame)
    return {name: np.array(taken) for name, taken in seconds.items()}


def _distribution(seconds: np.ndarray) -> dict[str, Any]:
    """Median in ms with its interval."""
    return milliseconds([seconds], min(20, max(1, len(seconds) // 5)))


def _homography(floor: MapImage, frames: Any) -> dict[str, Any]:
    locate, shown = HomographyLocalizer(floor).locate, progress(frames, "homography")
    seconds = [timeit(partial(locate, frame), number=1) for frame in shown]
    return _distribution(np.array(seconds[1:] or seconds))


def finding(record: Record) -> str:
    """What the experiment found, in two sentences."""
    timings = record.timings
    total = timings["total_ms"]["median"]
    text = f"On this machine a frame takes {number(total)} ms"
    if "histogram_share" in timings:
        text += f", {percent(timings['histogram_share'])} of it for the histogram."
    else:
        text += " from its histogram on, which came with the flight."
    if "homography_ms" in timings:
        ratio = timings["homography_ms"]["median"] / total
        text += f" A homography takes {so_often(ratio)} as long."
    return text


# label, place in the record's timings, key of the paper's value
_ROWS = (
    ("histogram", "stages_ms.histogram", "histogram_ms"),
    ("k nearest neighbours", "stages_ms.neighbors", ""),
    ("particle filter", "stages_ms.filter", ""),
    ("estimate and spread", "stages_ms.estimate", ""),
    ("neighbours, filter, estimate", "stages_ms.rest", "rest_ms"),
    ("whole frame", "total_ms", "total_ms"),
    ("whole frame, full sampling", "full_sampling_ms", "full_sampling_ms"),
    ("homography", "homography_ms", "homography_ms"),
)


def stages(record: Record) -> Figure:
    """Median time of each stage on a logarithmic axis, the paper's value beside it."""
    rows = [(label, look_up(record.timings, path), key) for label, path, key in _ROWS]
    rows = [row for row in rows if row[1] is not None]
    medians = [time["median"] for _, time, _ in rows]
    paper = dict(published()["timing"])
    paper["full_sampling_ms"] = 1000 / paper["full_sampling_hz"]
    places, height = range(len(rows)), 0.8 + 0.42 * len(rows)
    with canvas(size=(7.2, height)) as (figure, [[plot]]):
        plot.plot(medians, places, "o", color=COLORS["paper"], label="here")
        printed = [paper.get(key, np.nan) for _, _, key in rows]
        plot.plot(printed, places, "D", color=COLORS["printed"], label="the paper")
        label = f"one frame at {paper['camera_hz']:g} Hz"
        plot.axvline(1000 / paper["camera_hz"], color=COLORS["truth"], linestyle=":", label=label)
        labels = [f"{name}: {time['median']:.3g} ms" for name, time, _ in rows]
        plot.set_yticks(places, labels=labels)
        plot.set(xscale="log", xlabel="time a frame (ms)", ylim=(len(rows) - 0.5, -0.5))
        plot.xaxis.set_major_formatter("{x:g}")
        plot.grid(False, axis="y")
        plot.legend(loc="upper center", bbox_to_anchor=(0.4, -0.8 / height), ncols=3)
    return figure


EXPERIMENT = Experiment(
    "Time for one frame", Parameters, run, finding, needs=POSITIONS, cost_s=17, alone=True
)
