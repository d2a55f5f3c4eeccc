"""Localization by homography (paper, Analysis, "Baseline: Homography-based Approach"). Every frame
is registered to the mosaic, without a filter.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import IMAGES, Experiment, SeedParameters
from trexton.companion.experiments.evaluation import map_picture
from trexton.companion.experiments.metrics import summarize
from trexton.companion.experiments.mosaic import locate_all, stitched_map
from trexton.companion.experiments.style import COLORS, joined_plan
from trexton.companion.wording import distance, number
from trexton.flights.flight import Flight


@dataclass(frozen=True)
class Parameters(SeedParameters):
    """What can be chosen."""


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Locate every test frame on the mosaic of the training flight, unfiltered."""
    picture = stitched_map(train).map
    position = locate_all(picture, test)
    rng = stream(parameters.seed, "intervals")
    values: dict[str, Any] = {
        "mosaic": summarize([position], test.position, test.diagonal, rng=rng)
    }
    if test.attitude is not None and test.height is not None:
        # From the place below the vehicle to the floor point of the image's centre: unknown to the
        # method.
        offset = test.height * np.hypot(*np.tan(test.attitude[:, :2]).T)
        if len(offset := offset[np.isfinite(offset)]):  # a heading may be known where no tilt is
            values["tilt_offset_cm"] = 100 * float(offset.mean())
    extent, drawn = map_picture(picture, 900)
    series = {"mosaic_m": position, "truth_m": test.position, "area_m": test.area, "map": extent}
    return parameters.record(train, test, values=values, series=series, images={"map": drawn})


def finding(record: Record) -> str:
    """What the experiment found, in a few sentences."""
    values = record.values
    mosaic = values["mosaic"]
    if "mean_cm" not in mosaic:
        return "A homography finds no frame on the stitched map."
    missed = f"nothing in {number(mosaic['missing'])} frames"
    text = (
        f"A homography on the stitched map has an error of {distance(mosaic['mean_cm'])} and "
        f"finds {missed if mosaic['missing'] else 'every frame'}."
    )
    if "tilt_offset_cm" in values:
        text += f" Tilt moves the image's centre by {distance(values['tilt_offset_cm'])}."
    return text


def fixes(record: Record) -> Figure:
    """The fixes on the stitched map, each joined to the true position; crosses without a fix."""
    return joined_plan(record, "mosaic_m", "homography", COLORS["homography"], floor="map")


EXPERIMENT = Experiment(
    "Baseline: homography",
    Parameters,
    run,
    finding,
    IMAGES,
    ("mosaic", "mocap_training"),
    cost_s=130,
)
