"""The hyperspatial image, stitched from a flight's own frames (paper, Baseline, figure of the
map).
"""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import IMAGES, Experiment, SeedParameters, option
from trexton.companion.experiments.stitched import floor_residual, picture_of, stitched_map
from trexton.companion.wording import number
from trexton.evaluation.metrics import euclidean
from trexton.flights.flight import Flight

__all__ = ["EXPERIMENT", "finding", "Parameters", "run"]

_ARROWS = 400  # matched places that the figure of the deviation shows


@dataclass(frozen=True)
class Parameters(SeedParameters):
    """What can be chosen."""

    anchors: int = option(
        0, "training frames whose position places the map; 0 chooses as the flight needs", low=0
    )


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Stitch the training flight; compare with the true floor where the flight carries it.

    Parameters
    ----------
    train : Flight
        With images; the positions of `anchors` of its frames place the map in the world.
    test : Flight, optional
        Not used: nothing of the test flight may enter the map.
    """
    start = perf_counter()
    mosaic = stitched_map(train, parameters.anchors)
    seconds = perf_counter() - start
    extent, picture = picture_of(mosaic.map)
    error_cm = 100 * euclidean(mosaic.poses[:, :2], train.position)[mosaic.used]
    values = {
        "frames": len(train),
        "used": int(mosaic.used.sum()),
        "anchors": len(mosaic.anchors),
        "links": len(mosaic.links),
        "rejected_links": mosaic.rejected,
        "link_error_px": _spread(mosaic.errors),
        "frame_position_error_cm": _spread(error_cm),
        "pixels_per_metre": 1 / float(np.hypot(*mosaic.map.world_from_pixel[:2, 0])),
        "size_px": mosaic.map.image.shape[1::-1],
    }
    series = {"map": extent, "area_m": train.area, "frames_m": train.position}
    series["anchors_m"] = train.position[mosaic.anchors]
    if train.floor is not None:
        truth, deviation = floor_residual(mosaic.map, train.floor)
        values["residual_cm"] = _spread(100 * np.hypot(*deviation.T)) | {"matches": len(truth)}
        rows = stream(parameters.seed, "arrows").permutation(len(truth))[:_ARROWS]
        series |= {"residual_at_m": truth[rows], "residual_m": deviation[rows]}
    return parameters.record(
        train,
        values=values,
        series=series,
        images={"map": picture},
        timings={"stitching_s": seconds},
    )


def _spread(values: np.ndarray) -> dict[str, Any]:
    rms = np.sqrt(np.mean(np.square(values)))
    return {"median": np.median(values), "p95": np.percentile(values, 95), "rms": rms}


def finding(record: Record) -> str:
    """What the experiment found, in a sentence."""
    values = record.values
    text = (
        f"{values['used']} of {values['frames']} frames were stitched into one map, placed by the "
        f"positions of {values['anchors']}"
    )
    if "residual_cm" in values:
        text += (
            f", and it lies {number(values['residual_cm']['median'])} cm off the true floor in the "
            f"median, {number(values['residual_cm']['p95'])} cm at the 95th percentile"
        )
    return text + "."


EXPERIMENT = Experiment(
    "The map, stitched from the flight", Parameters, run, finding, needs=IMAGES, cost_s=115
)
