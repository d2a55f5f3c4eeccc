"""The hyperspatial image, stitched from a flight's own frames (paper, Baseline, figure of the map).

Offers the maps of a flight, and where they put its frames, to the homography experiments too.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from trexton.base.cache import cached
from trexton.base.progress import progress
from trexton.base.records import Record
from trexton.companion.experiments.declaration import IMAGES, Experiment, SeedParameters
from trexton.companion.experiments.evaluation import map_picture
from trexton.companion.experiments.homography import HomographyLocalizer
from trexton.companion.experiments.metrics import euclidean
from trexton.companion.experiments.style import SERIES, legend_below, plan_canvas
from trexton.companion.wording import distance
from trexton.flights.flight import Flight
from trexton.registration.mosaic import Mosaic, stitch
from trexton.vision.camera import MapImage

_REPEATS = 0.1  # of the links that contradict the others, from which on a floor repeats itself
_PLAIN = "poses", "used", "anchors", "left_out", "errors"  # stored as they are


@dataclass(frozen=True)
class Parameters(SeedParameters):
    """What can be chosen."""


def run(train: Flight, test: Flight, parameters: Parameters) -> Record:
    """Stitch the training flight; compare where it puts the frames with where they were taken.

    Parameters
    ----------
    train : Flight
        With images; the positions of a few of its frames place the map in the world.
    test : Flight, optional
        Not used: nothing of the test flight may enter the map.
    """
    mosaic = stitched_map(train)
    extent, picture = map_picture(mosaic.map, 900)
    error_cm = 100 * euclidean(mosaic.poses[:, :2], train.position)
    # The map was bent to the anchors: each is held against the map without it.
    error_cm[mosaic.anchors] = 100 * mosaic.left_out
    error_cm = error_cm[mosaic.used & train.located]
    values = {
        "frames": len(train),
        "used": int(mosaic.used.sum()),
        "anchors": len(mosaic.anchors),
        "links": len(mosaic.errors),
        "rejected_links": mosaic.rejected,
        "link_error_px": _spread(mosaic.errors),
        "frame_position_error_cm": _spread(error_cm),
        "doubt": mosaic.doubt,
    }
    series = {"map": extent, "area_m": train.area, "frames_m": train.position}
    series["anchors_m"] = train.position[mosaic.anchors]
    return parameters.record(train, values=values, series=series, images={"map": picture})


def _spread(values: np.ndarray) -> dict[str, Any]:
    rms = np.sqrt(np.mean(np.square(values)))
    return {"median": np.median(values), "p95": np.percentile(values, 95), "rms": rms}


def stitched_map(train: Flight) -> Mosaic:
    """The mosaic of `train`, from the cache if it was stitched before."""

    def compute() -> dict[str, np.ndarray]:
        mosaic = stitch(train)
        return {
            "image": mosaic.map.image,
            "world_from_pixel": mosaic.map.world_from_pixel,
            "mask": mosaic.map.mask,
            "rejected": np.int64(mosaic.rejected),
            **{name: getattr(mosaic, name) for name in _PLAIN},
        }

    inputs = {"flight": train.data_hash}
    kept = cached("mosaic", "trexton.registration.mosaic", inputs, compute)
    return Mosaic(
        map=MapImage(kept["image"], kept["world_from_pixel"], kept["mask"]),
        rejected=int(kept["rejected"]),
        **{name: kept[name] for name in _PLAIN},
    )


def locate_all(picture: MapImage, flight: Flight) -> np.ndarray:
    """``(N, 2)`` metres: every frame of a flight on a map, unfiltered; NaN: no homography."""
    localizer = HomographyLocalizer(picture)
    images = progress(flight.images(), "locating", len(flight))
    return np.array([localizer.locate(image) for image in images])


def finding(record: Record) -> str:
    """What the experiment found, in a few sentences."""
    values = record.values
    off = distance(values["frame_position_error_cm"]["median"])
    text = (
        f"{values['used']} of {values['frames']} frames were stitched into one map, placed by the "
        f"positions of {values['anchors']}. It puts frames {off} off (median), each of these "
        "without its own position."
    )
    rejected, links = values["rejected_links"], values["links"] + values["rejected_links"]
    if rejected > _REPEATS * links:
        text += (
            f" {rejected} of {links} links contradict the others: the floor repeats itself, and "
            "loops through them do not close."
        )
    return text + (f" The map is not to be trusted: {values['doubt']}." if values["doubt"] else "")


def stitched(record: Record) -> Figure:
    """The mosaic, the frames' true positions and the few that placed it in the world."""
    series = record.series
    frames, anchors = np.array(series["frames_m"]), np.array(series["anchors_m"])
    with plan_canvas(record, (6.2, 6.4), "map", fade=1.0) as (figure, plan):
        plan.plot(*frames.T, color="white", linewidth=0.7, alpha=0.8)
        dot: dict[str, Any] = {"color": SERIES[1], "markeredgecolor": "white", "markersize": 6}
        plan.plot(*anchors.T, "o", label="frames that place it", **dot)
        legend_below(plan, 0.1)
    return figure


EXPERIMENT = Experiment(
    "The map, stitched from the flight", Parameters, run, finding, needs=IMAGES, cost_s=115
)
