"""Coarse to fine: textons say where about, the image says exactly where.

Beyond the paper. The recorded flight on two maps of its floor; virtual flights over floors on which
nothing was tuned, repeating ones among them; kidnappings. Times are those of the processor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion import wording
from trexton.companion.executor import spread
from trexton.companion.experiments.declaration import SURVEYED, Experiment, option
from trexton.companion.experiments.followed import (
    ATTITUDES,
    GROSS,
    QUARTERS,
    SETTLED,
    FollowedParameters,
    follow,
    kidnapped,
    measured_attitude,
    over_floor,
)
from trexton.companion.experiments.mosaic import stitched_map
from trexton.companion.experiments.style import COLORS, canvas, legend_above
from trexton.companion.experiments.track import HELD
from trexton.evaluation.metrics import euclidean, mean_over_groups, mean_with_interval, success_rate
from trexton.evaluation.runtime import of_frames
from trexton.flights.flight import Flight
from trexton.registration import FloorTracker
from trexton.vision.camera import MapImage


@dataclass(frozen=True)
class Parameters(FollowedParameters):
    """What can be chosen."""

    kidnappings: int = option(3, "times that the vehicle is kidnapped", low=1)


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Fly coarse to fine over the test flight, over virtual floors, and kidnapped.

    Parameters
    ----------
    train, test : Flight
        With images, a picture of the floor, and a camera.
    """
    given, given_series, seconds = _recorded(train, test, parameters)
    trials = spread(partial(over_floor, parameters), range(parameters.floors), "floors")
    kidnappings = spread(
        partial(kidnapped, parameters), range(parameters.kidnappings), "kidnappings"
    )
    pooled = {
        name: _summary(np.concatenate([trial["rows"][name] for trial in trials]))
        for name in ATTITUDES
    }
    return parameters.record(
        train, test,
        values={
            "flight": given,
            "floors": {
                trial["name"]: {name: _summary(rows) for name, rows in trial["rows"].items()}
                for trial in trials
            },
            "all": pooled,
            "peers": _peers(trials),
            "kidnapped": kidnapping_summary(kidnappings),
        },
        series=given_series
        | {"errors_cm": {name: _quantiles(trials, name) for name in ATTITUDES}},
        timings={
            name: of_frames(np.concatenate([trial["seconds"][name] for trial in trials]), "_s")
            for name in trials[0]["seconds"]
        } | {"flight": seconds},
    )  # fmt: skip


def _summary(rows: np.ndarray) -> dict[str, Any]:
    error, distance, lost, quarter = rows.T
    inside = distance < HELD
    return {
        "frames": len(rows),
        "mean_cm": 100 * error.mean(),
        "median_cm": 100 * np.median(error),
        "p95_cm": 100 * np.percentile(error, 95),
        "max_cm": 100 * error.max(),
        "gross": int((error > GROSS).sum()),
        "lost": lost.mean(),
        "region_90": inside.mean(),
        "region_90_quarters": [inside[quarter == part].mean() for part in range(QUARTERS)],
        "nees": distance.mean() / 2,
    }


def _quantiles(trials: list[dict[str, Any]], name: str) -> dict[str, Any]:
    shares = np.linspace(0, 100, 101)
    error = np.concatenate([trial["rows"][name][:, 0] for trial in trials])
    return {"share": shares, "error": 100 * np.percentile(error, shares)}


def _recorded(
    train: Flight, test: Flight, parameters: Parameters
) -> tuple[dict[str, Any], dict[str, Any], dict[str, float]]:
    """The test flight on the surveyed and on the stitched map."""
    assert test.floor is not None and test.camera is not None
    assert test.height is not None and test.attitude is not None
    height = float(np.median(test.height))
    pictures: dict[str, MapImage] = {"surveyed": test.floor, "stitched": stitched_map(train).map}
    trackers = {
        (where, name): FloorTracker(picture, test.camera, height)
        for where, picture in pictures.items()
        for name in ATTITUDES
    }
    rng = stream(parameters.seed, "recorded")
    track: dict[tuple[str, str], list[np.ndarray]] = {key: [] for key in trackers}
    seconds = []
    for row, image in enumerate(test.images()):
        for key, tracker in trackers.items():
            attitude = measured_attitude(test.attitude[row], key[1], parameters, rng)
            fix, taken = follow(tracker, image, attitude)
            track[key].append(fix.position)
            seconds.append(taken)
    values: dict[str, Any] = {where: {} for where in pictures}
    series: dict[str, Any] = {"time_s": test.time - test.time[0], "truth_m": test.position}
    for (where, name), positions in track.items():
        # The stream keeps the name it was first drawn under, so that numbers stay the same.
        drawing = stream(parameters.seed, f"intervals {where} {name.replace('tilt_bias', 'askew')}")
        error = euclidean(np.array(positions), test.position)
        settled = error[SETTLED:]
        values[where][name] = {
            "mean_cm": mean_with_interval(100 * settled[None], drawing),
            "p95_cm": 100 * np.percentile(settled, 95),
            "max_cm": 100 * settled.max(),
            "gross": int((settled > GROSS).sum()),
        }
        series[f"{where}_{name}_cm"] = 100 * error
    return values, series, of_frames(np.array(seconds), "_s")


def kidnapping_summary(trials: list[dict[str, Any]]) -> dict[str, Any]:
    """What many kidnappings say: how often found, and whether lost was said of the right frames.

    Kidnappings over one floor, and their frames, may be alike: rates are over floors.
    """
    floors = [trial["floor"] for trial in trials]
    calm = slice(5, SETTLED)

    def rate(happened: Sequence[Any], of: Sequence[Any]) -> dict[str, Any] | None:
        counts = ([np.sum(each) for each in column] for column in (happened, of))
        return success_rate(*(np.bincount(floors, each).astype(int) for each in counts))

    found = [trial["found"] for trial in trials if trial["found"] is not None]
    right, lost = ([trial[key] for trial in trials] for key in ("right", "lost"))
    both = list(zip(right, lost, strict=True))
    return {
        "found_rate": rate([trial["found"] is not None for trial in trials], [True] * len(trials)),
        "frames": {"median": float(np.median(found)), "longest": max(found)} if found else None,
        "wrong_not_lost": rate(
            [~near & ~flagged for near, flagged in both], [~near for near in right]
        ),
        "right_lost": rate(
            [(near & flagged)[calm] for near, flagged in both], [near[calm] for near in right]
        ),
    }


def _peers(trials: list[dict[str, Any]]) -> dict[str, Any]:
    """For each keypoint method: frames tried, share within 30 cm, errors of those."""
    values = {}
    for name in trials[0]["peers"]:
        error = np.concatenate([trial["peers"][name] for trial in trials])
        right = error[error < GROSS]  # NaN, where nothing was found, is not
        values[name] = {
            "frames": len(error),
            "right": len(right) / len(error),
            "mean_cm": 100 * right.mean() if len(right) else None,
        }
    return values


def over_floors(
    record: Record, name: str, quantity: str, highest: float = np.inf
) -> dict[str, float | None]:
    """Mean of what stands in the record for each floor, with its 95 % interval over floors: frames
    over one floor share its print, and what was learned over it.
    """
    values = [floor[name][quantity] for floor in record.values["floors"].values()]
    return mean_over_groups(values, highest=highest)


def finding(record: Record, long: Record | None = None) -> str:
    """What the experiment found, in three sentences; over floors in the longer run, if there is
    one.
    """
    over = long or record
    everything = over.values["all"]
    with_attitude, without = (
        wording.interval(over_floors(over, key, "mean_cm"), "cm") for key in ("attitude", "free")
    )
    frames = sum(everything[key]["frames"] for key in ATTITUDES)
    gross = sum(everything[key]["gross"] for key in ATTITUDES)
    stitched = wording.distance(record.values["flight"]["stitched"]["free"]["mean_cm"])
    return (
        f"Over {len(over.values['floors'])} floors the mean error is {with_attitude} with the "
        f"autopilot's attitude and {without} without. {gross} of {frames:,} frames are off by more "
        f"than {100 * GROSS:.0f} cm. On a map stitched from the flight itself it is {stitched} "
        "without attitude."
    )


_LINES = {
    "attitude": (COLORS["fine"], "-"),
    "tilt_bias": (COLORS["field"], "-."),
    "free": (COLORS["zone"], "--"),
}


def over_time(record: Record) -> Figure:
    """Error over the recorded flight, on the surveyed map above and on the stitched one below."""
    time = np.array(record.series["time_s"])
    with canvas(2, 1, size=(7.2, 4.4), sharex=True, sharey=True) as (figure, axes):
        for plot, where in zip(axes[:, 0], ("surveyed", "stitched"), strict=True):
            for name in ("attitude", "free"):  # a tilt bias would lie upon the first
                color, style = _LINES[name]
                error = np.array(record.series[f"{where}_{name}_cm"], dtype=float)
                plot.plot(time, error, style, color=color, linewidth=1.0, label=ATTITUDES[name])
            plot.set(ylabel=f"{where} map:\nerror (cm)", ylim=(0, None))
        legend_above(axes[0, 0])
        axes[1, 0].set(xlabel="time (s)", xlim=(0, time[-1]))
    return figure


def errors_over_floors(record: Record) -> Figure:
    """Share of frames with at most so large an error, over all floors."""
    with canvas(size=(6.4, 3.4)) as (figure, axes):
        plot = axes[0, 0]
        for name, (color, style) in _LINES.items():
            series: dict[str, Any] = record.series["errors_cm"][name]
            label = f"{ATTITUDES[name]}, {record.values['all'][name]['frames']:,} frames"
            plot.plot(series["error"], series["share"], style, color=color, label=label)
        plot.set(xlabel="error (cm)", ylabel="frames (%)", xscale="log", ylim=(0, 101))
        plot.xaxis.set_major_formatter("{x:g}")
        legend_above(plot, columns=2)
    return figure


EXPERIMENT = Experiment(
    "Method fine: image registration", Parameters, run, finding,
    needs=SURVEYED, after=("mosaic",), cost_s=40,
)  # fmt: skip
