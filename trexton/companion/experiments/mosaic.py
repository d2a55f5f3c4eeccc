"""The hyperspatial image, stitched from a flight's own frames (paper, Baseline, figure of the
map).
"""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments.declaration import IMAGES, Experiment, SeedParameters, option
from trexton.companion.experiments.stitched import floor_residual, picture_of, stitched_map
from trexton.companion.experiments.style import (
    SERIES,
    legend_below,
    plan_canvas,
)
from trexton.companion.wording import number
from trexton.evaluation.metrics import euclidean
from trexton.flights.flight import Flight

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


def stitched(record: Record) -> Figure:
    """The mosaic, the frames' true positions and the few that placed it in the world."""
    series = record.series
    frames, anchors = np.array(series["frames_m"]), np.array(series["anchors_m"])
    with plan_canvas(record, (6.2, 6.4), "map", fade=1.0) as (figure, plan):
        plan.plot(*frames.T, color="white", linewidth=0.7, alpha=0.8)
        plan.plot(
            *anchors.T, "o", color=SERIES[1], markeredgecolor="white", markersize=6,
            label="frames that place it",
        )  # fmt: skip
        legend_below(plan, 0.1)
    return figure


def deviation(record: Record, magnified: float = 20.0) -> Figure:
    """Arrows from true places to where the mosaic shows them, lengthened `magnified` times."""
    series = record.series
    places, offsets = np.array(series["residual_at_m"]), np.array(series["residual_m"])
    with plan_canvas(record, (6.2, 6.2), "map", fade=0.35) as (figure, plan):
        length = 100 * np.hypot(*offsets.T)
        as_long: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1, "width": 0.004}
        as_long["label"] = "deviation (cm)"
        arrows = plan.quiver(*places.T, *(magnified * offsets.T), length, cmap="viridis", **as_long)
        # A mismatch or two on a tiled mat must not set the scale.
        arrows.set_clim(0, np.percentile(length, 98))
        label = f"deviation (cm); arrows {magnified:.0f} times as long"
        figure.colorbar(arrows, ax=plan, label=label, shrink=0.7, extend="max")
    return figure


EXPERIMENT = Experiment(
    "The map, stitched from the flight", Parameters, run, finding, needs=IMAGES, cost_s=115
)
