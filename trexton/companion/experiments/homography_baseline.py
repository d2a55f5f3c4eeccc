"""Localization by homography (paper, Analysis, "Baseline: Homography-based Approach")."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.errors import MapError
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import IMAGES, Experiment
from trexton.companion.experiments.evaluation import map_picture
from trexton.companion.experiments.mosaic import (
    FEWEST_ANCHORS,
    SAME_PASS_FRAMES,
    MosaicParameters,
    drifting_map,
    floor_residual,
    locate_all,
    stitched_map,
)
from trexton.companion.experiments.style import COLORS, legend_below, plan_canvas
from trexton.companion.wording import interval, middle, number
from trexton.evaluation.metrics import summarize
from trexton.evaluation.runtime import of_frames
from trexton.flights.flight import Flight


@dataclass(frozen=True)
class Parameters(MosaicParameters):
    """What can be chosen."""


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Locate every test frame on the mosaic of the training flight, unfiltered, and beside it on
    other maps.

    The true floor, where the flight carries it, is a perfect map: the difference is the price of
    the mosaic. A mosaic that drifts, because it never notices a place again, shows what a distorted
    map costs.

    Parameters
    ----------
    train, test : Flight
        With images.
    """
    maps = {"mosaic": stitched_map(train, parameters.anchors).map}
    with suppress(MapError):  # some flights hang together only by places that are seen again
        maps["drifting"] = drifting_map(train, parameters.anchors)
    if test.floor is not None:
        maps["perfect_floor"] = test.floor
    located = locate_all(maps, test)
    rng = stream(parameters.seed, "intervals")
    values: dict[str, Any] = {
        name: summarize([position], test.position, test.diagonal, rng=rng)
        for name, (position, _) in located.items()
    }
    if "drifting" in maps:
        values["drift"] = {"linked_frames": SAME_PASS_FRAMES, "anchors": FEWEST_ANCHORS}
    for name in ("mosaic", "drifting"):
        if name in maps and train.floor is not None:
            _, deviation = floor_residual(maps[name], train.floor)
            values[name]["map_residual_cm"] = 100 * float(np.median(np.hypot(*deviation.T)))
    if test.attitude is not None and test.height is not None:
        # From the place below the vehicle to the floor point of the image's centre: unknown to the
        # method.
        offset = test.height * np.hypot(*np.tan(test.attitude[:, :2]).T)
        if len(offset := offset[np.isfinite(offset)]):  # a heading may be known where no tilt is
            values["tilt_offset_cm"] = 100 * float(offset.mean())
    extent, picture = map_picture(maps["mosaic"], 900)
    series = {f"{name}_m": position for name, (position, _) in located.items()}
    return parameters.record(
        train,
        test,
        values=values,
        series=series | {"truth_m": test.position, "area_m": test.area, "map": extent},
        images={"map": picture},
        timings={"locate_s": of_frames(located["mosaic"][1])},
    )


def finding(record: Record) -> str:
    """What the experiment found, in a few sentences."""
    values = record.values
    mosaic = values["mosaic"]
    if "mean_cm" not in mosaic:
        return "A homography finds no frame on the stitched map."
    missed = f"nothing in {number(mosaic['missing'])} frames"
    text = (
        f"A homography on the stitched map has an error of {interval(mosaic['mean_cm'], 'cm')} and "
        f"finds {missed if mosaic['missing'] else 'every frame'}."
    )
    if "tilt_offset_cm" in values:
        text += f" The camera's tilt alone costs {number(values['tilt_offset_cm'])} cm."
    if error := values.get("drifting", {}).get("mean_cm"):
        text += f" On a map that drifts the error is {number(middle(error))} cm."
    return text


def fixes(record: Record) -> Figure:
    """The fixes on the stitched map, each joined to the true position; crosses without a fix."""
    series = record.series
    color = COLORS["homography"]
    truth, position = np.array(series["truth_m"]), np.array(series["mosaic_m"], dtype=float)
    lost = ~np.isfinite(position).all(axis=1)
    with plan_canvas(record, (5.6, 5.6), "map") as (figure, plan):
        for true, fix in zip(truth[~lost], position[~lost], strict=True):
            plan.plot(*zip(true, fix, strict=True), color=color, linewidth=0.6, alpha=0.6)
        plan.plot(*truth.T, color=COLORS["truth"], linewidth=1.6, label="true track")
        plan.plot(*position[~lost].T, ".", color=color, markersize=3, label="homography")
        if lost.any():
            label = f"no homography ({lost.sum()})"
            plan.plot(*truth[lost].T, "x", color=color, label=label)
        legend_below(plan, 0.11, columns=3)
    return figure


EXPERIMENT = Experiment(
    "Baseline: homography",
    Parameters,
    run,
    finding,
    needs=IMAGES,
    after=("mosaic", "mocap_training"),
    cost_s=130,
)
