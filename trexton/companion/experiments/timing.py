"""Time for one frame, stage by stage (paper, Analysis, "Speed versus Accuracy Trade-Off";
Discussion).
"""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.progress import progress
from trexton.base.records import Record, machine
from trexton.base.streams import stream
from trexton.companion.executor import limited_threads
from trexton.companion.experiments.declaration import POSITIONS, Experiment, MapParameters, option
from trexton.companion.experiments.evaluation import frames_of, map_of
from trexton.companion.experiments.printed import published
from trexton.companion.experiments.style import COLORS, canvas, legend_below
from trexton.companion.experiments.track import fly
from trexton.companion.wording import number, percent
from trexton.companion.wording import times as so_often
from trexton.evaluation.runtime import STAGES, StageTimer, frequency, milliseconds
from trexton.flights.flight import Flight
from trexton.localization.localizer import Localizer
from trexton.registration.homography import HomographyLocalizer
from trexton.vision.patches import position_grid


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

    Parameters
    ----------
    train, test : Flight
        With images, or with histograms; then there is no histogram to time, and no homography.
    """
    texton_map = map_of(train, parameters)
    frames, options = (
        frames_of(test),
        {"samples": parameters.samples, "particles": parameters.particles},
    )

    def localizer(**changes: Any) -> Localizer:
        return Localizer(texton_map, rng=stream(parameters.seed, "flight", 0), **options | changes)

    def clocked() -> StageTimer:
        return StageTimer(texton_map, rng=stream(parameters.seed, "flight", 0), **options)

    with limited_threads(1):
        for frame in frames[:2]:  # whatever the first calls load
            localizer().step(frame)
        totals, clocks = [], []
        for _ in progress(range(parameters.passes), "timing the flight"):
            totals.append(fly(localizer(), frames).step_s)
            clock = clocked()
            for frame in frames:
                clock.step(frame)
            clocks.append(clock.seconds)
        full = (
            _full_sampling(localizer(samples=None), frames[: parameters.full_frames])
            if test.has_images
            else {}
        )
    total_s = np.median(totals, axis=0)
    stages_s = {
        name: np.median([one[name] for one in clocks], axis=0) for name in STAGES if clocks[0][name]
    }
    timings: dict[str, Any] = {
        "machine": machine(),
        "total_ms": _distribution(total_s),
        "frequency_hz": frequency(milliseconds([total_s])),
        "stages_ms": {name: _distribution(seconds) for name, seconds in stages_s.items()},
        "frames_ms": {
            name: 1000 * seconds for name, seconds in ({"total": total_s} | stages_s).items()
        },
    } | full
    if test.has_images:
        medians = {name: np.median(seconds) for name, seconds in stages_s.items()}
        timings["histogram_share"] = float(medians["histogram"] / sum(medians.values()))
    if test.has_images and test.floor is not None:
        timings["homography_ms"] = _homography(
            test, frames[:: max(1, len(frames) // parameters.homography_frames)]
        )
    return parameters.record(
        train, test,
        values={
            "applies": {"histogram": test.has_images, "homography": "homography_ms" in timings},
            "counts": {"train": len(texton_map.positions), "test": len(test)},
            "patches_per_image": _patches(texton_map) if test.has_images else None,
            "camera_hz": 1 / np.median(np.diff(test.time)),
        },
        timings=timings,
    )  # fmt: skip


def _distribution(seconds: np.ndarray) -> dict[str, Any]:
    """Median in ms with its interval, and the 99th percentile of frames."""
    stretch = min(20, max(1, len(seconds) // 5))
    return milliseconds([seconds], stretch) | {"p99": 1000 * np.percentile(seconds, 99)}


def _full_sampling(localizer: Localizer, frames: Any) -> dict[str, Any]:
    step_s = fly(localizer, frames).step_s
    return {
        "full_sampling_ms": _distribution(step_s),
        "full_sampling_hz": frequency(milliseconds([step_s])),
    }


def _homography(test: Flight, frames: Any) -> dict[str, Any]:
    assert test.floor is not None  # asked for where this is called
    localizer, seconds = HomographyLocalizer(test.floor), []
    for frame in progress(frames, "homography"):
        start = perf_counter()
        localizer.locate(frame)
        seconds.append(perf_counter() - start)
    return _distribution(np.array(seconds[1:] or seconds))


def _patches(texton_map: Any) -> int:
    return int(np.prod(position_grid(texton_map.image_shape, texton_map.dictionary.patch)))


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    timings = record.timings
    total = timings["total_ms"]["median"]
    text = f"On this machine a frame takes {number(total)} ms"
    if "histogram_share" in timings:
        text += f", {percent(timings['histogram_share'])} of it for the histogram"
    else:
        text += " from its histogram on, which came with the flight"
    if "homography_ms" in timings:
        homography = timings["homography_ms"]["median"]
        text += (
            f"; a homography takes {number(homography)} ms, {so_often(homography / total)} as long"
        )
    return text + "."


# record's key: (label, key of the paper's value or None)
_ROWS = {
    "histogram": ("histogram", "histogram_ms"),
    "neighbors": ("k nearest neighbours", None),
    "filter": ("particle filter", None),
    "estimate": ("estimate and spread", None),
    "rest": ("neighbours, filter, estimate", "rest_ms"),
    "total": ("whole frame", "total_ms"),
    "full": ("whole frame, full sampling", "full_sampling_ms"),
    "homography": ("homography", "homography_ms"),
}


def times(record: Record) -> dict[str, dict[str, Any]]:
    """Median and 99th percentile in ms of every row of the figure that this flight has."""
    timings = record.timings
    found = dict(timings["stages_ms"])
    parts = [timings["frames_ms"][name] for name in ("neighbors", "filter", "estimate")]
    rest = np.sum(parts, axis=0)
    found["rest"] = {"median": float(np.median(rest)), "p99": float(np.percentile(rest, 99))}
    found["total"] = timings["total_ms"]
    optional = {"full": "full_sampling_ms", "homography": "homography_ms"}
    found |= {row: timings[key] for row, key in optional.items() if key in timings}
    return {name: found[name] for name in _ROWS if name in found}


def stages(record: Record) -> Figure:
    """Each stage on a logarithmic axis: median to 99th percentile, the paper's value beside it."""
    ours, paper = times(record), dict(published()["timing"])
    paper["full_sampling_ms"] = 1000 / paper["full_sampling_hz"]
    with canvas(size=(7.2, 0.8 + 0.42 * len(ours))) as (figure, axes):
        plot = axes[0, 0]
        for place, (name, time) in enumerate(reversed(ours.items())):
            at = (time["median"], place)
            plot.hlines(
                place, time["median"], time["p99"], color=COLORS["paper"], linewidth=4, alpha=0.3
            )
            label = "here, to the 99th percentile" if not place else None
            plot.plot(*at, "o", color=COLORS["paper"], label=label)
            style: dict[str, Any] = {"textcoords": "offset points", "ha": "center", "fontsize": 8}
            plot.annotate(f"{time['median']:.3g} ms", at, xytext=(0, 6), **style)
            if (key := _ROWS[name][1]) is not None:
                label = "the paper" if key == "total_ms" else None
                plot.plot(paper[key], place, "D", color=COLORS["printed"], label=label)
        camera = paper["camera_hz"]
        plot.axvline(
            1000 / camera, color=COLORS["truth"], linestyle=":", label=f"one frame at {camera:g} Hz"
        )
        plot.set_yticks(range(len(ours)), labels=[_ROWS[name][0] for name in reversed(ours)])
        plot.set(xscale="log", xlabel="time a frame (ms)", ylim=(-0.6, len(ours) - 0.2))
        plot.margins(x=0.07)
        plot.xaxis.set_major_formatter("{x:g}")
        plot.grid(False, axis="y")
        plot.legend(
            loc="upper center", bbox_to_anchor=(0.4, -0.8 / (0.8 + 0.42 * len(ours))), ncols=3
        )
    return figure


def frames(record: Record) -> Figure:
    """The time of every frame of the flight, split by stage."""
    split = {name: np.array(values) for name, values in record.timings["frames_ms"].items()}
    del split["total"]
    total = record.timings["total_ms"]
    colors = {
        "histogram": COLORS["zone"], "neighbors": COLORS["neighbors"],
        "filter": COLORS["particles"], "estimate": COLORS["paper"],
    }  # fmt: skip
    with canvas(size=(7.2, 3.0)) as (figure, axes):
        plot = axes[0, 0]
        count = len(next(iter(split.values())))
        plot.stackplot(
            np.arange(count), *split.values(), labels=[_ROWS[name][0] for name in split],
            colors=[colors[name] for name in split], step="mid", linewidth=0,
        )  # fmt: skip
        whole = np.sum(list(split.values()), axis=0)
        plot.step(
            np.arange(count), whole, where="mid", color=COLORS["truth"], linewidth=0.5,
            label="whole frame",
        )  # fmt: skip
        for key, style in (("median", "-"), ("p99", "--")):
            label = {"median": "median", "p99": "99th percentile"}[key]
            plot.axhline(
                total[key], color=COLORS["truth"], linestyle=style, linewidth=1, label=label
            )
        plot.set(
            xlabel="frame", ylabel="time (ms)", xlim=(0, count - 1), ylim=(0, 1.6 * total["p99"])
        )
        legend_below(plot, 0.22, columns=3)
    return figure


EXPERIMENT = Experiment(
    "Time for one frame", Parameters, run, finding, needs=POSITIONS, cost_s=17, alone=True
)
