"""Localization by homography (paper, Analysis, "Baseline: Homography-based Approach")."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import IMAGES, Experiment, SeedParameters, option
from trexton.companion.experiments.evaluation import floor_picture
from trexton.companion.experiments.stitched import (
    FEWEST_ANCHORS,
    SAME_PASS_FRAMES,
    Located,
    floor_residual,
    homography_maps,
    locate_all,
    picture_of,
)
from trexton.companion.wording import interval, middle, number
from trexton.evaluation.metrics import euclidean, summarize
from trexton.evaluation.runtime import of_frames
from trexton.flights.flight import Flight

__all__ = ["EXPERIMENT", "finding", "Parameters", "run"]


@dataclass(frozen=True)
class Parameters(SeedParameters):
    """What can be chosen."""

    anchors: int = option(
        0, "training frames whose position places the mosaic; 0 chooses as the flight needs", low=0
    )


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Locate every test frame on the mosaic of the training flight, unfiltered, and beside it on
    other maps.

    The true floor, where the flight carries it, is a perfect map: the difference is the price of
    the mosaic. A mosaic that drifts, because it never notices a place again, shows what a distorted
    map costs. Frames at half size on the mosaic show what the quicker mode loses.

    Parameters
    ----------
    train, test : Flight
        With images.
    """
    maps = homography_maps(train, parameters.anchors)
    mosaic = maps["mosaic"]
    if test.floor is not None:
        maps["perfect_floor"] = test.floor
    located = locate_all(maps, test) | {
        "half": locate_all({"mosaic": mosaic}, test, scale=0.5)["mosaic"]
    }
    rng = stream(parameters.seed, "intervals")
    values: dict[str, Any] = {
        name: summarize([each.position], test.position, test.diagonal, rng=rng)
        | _counts(each, test)
        for name, each in located.items()
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
    extent, picture = picture_of(mosaic)
    floor, floor_image = floor_picture(test)
    series: dict[str, Any] = {f"{name}_m": each.position for name, each in located.items()}
    series |= {f"{name}_inliers": each.inliers for name, each in located.items()}
    series |= {"time_s": test.time - test.time[0], "truth_m": test.position}
    series |= {"area_m": test.area, "map": extent}
    return parameters.record(
        train,
        test,
        values=values,
        series=series | floor,
        images={"map": picture} | floor_image,
        timings={
            name: of_frames(located[key].seconds)
            for name, key in (("locate_s", "mosaic"), ("locate_half_s", "half"))
        },
    )


def _counts(located: Located, test: Flight) -> dict[str, Any]:
    """Frames without a homography, and with one that is off by more than half the width of the
    area.
    """
    error = euclidean(located.position, test.position)
    x_min, x_max, y_min, y_max = test.area
    gross = error > min(x_max - x_min, y_max - y_min) / 2
    return {
        "failures": int((~located.found).sum()),
        "gross_errors": int(gross[located.found].sum()),
    }


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    values = record.values
    mosaic = values["mosaic"]
    if "mean_cm" not in mosaic:
        text = "A homography finds no frame on the stitched map"
    else:
        text = (
            f"A homography on the stitched map errs by {interval(mosaic['mean_cm'], 'cm')} and "
            "finds "
            + (f"nothing in {mosaic['failures']} frames" if mosaic["failures"] else "every frame")
        )
    if "tilt_offset_cm" in values and "map_residual_cm" in mosaic:
        tilt, bent = values["tilt_offset_cm"], mosaic["map_residual_cm"]
        weighs = "weighs more in that than" if tilt > bent else "weighs less in that than"
        text += f"; the camera's tilt ({number(tilt)} cm) {weighs} the map ({number(bent)} cm off)"
    if error := values.get("drifting", {}).get("mean_cm"):
        text += f"; on a map that drifts it errs by {number(middle(error))} cm"
    return text + "."


EXPERIMENT = Experiment(
    "Baseline: homography",
    Parameters,
    run,
    finding,
    needs=IMAGES,
    after=("mosaic", "mocap_training"),
    cost_s=130,
)
