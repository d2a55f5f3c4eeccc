"""Localization by homography (paper, Analysis, "Baseline: Homography-based Approach")."""

from __future__ import annotations

import numpy as np

from trexton.experiments.evaluation import floor_picture, provenance
from trexton.experiments.stitched import Located, locate_all, picture_of, stitched_map
from trexton.flights.flight import Flight
from trexton.metrics import summarize
from trexton.records import Record

__all__ = ["run"]


def run(train: Flight, test: Flight, *, anchors: int = 12, seed: int = 1) -> Record:
    """Locate every test frame on the mosaic of the training flight, unfiltered, and beside it on the true floor.

    The true floor, where the flight carries it, is a perfect map: the difference is the price of the mosaic.

    Parameters
    ----------
    train, test : Flight
        With images.
    anchors : int
        Training frames whose motion-capture position places the mosaic.
    """
    mosaic = stitched_map(train, anchors).map
    located = {"mosaic": locate_all(mosaic, test, "on the mosaic")}
    if test.floor is not None:
        located["perfect_floor"] = locate_all(test.floor, test, "on the true floor")
    rng = np.random.default_rng([seed, 0])
    values = {
        name: summarize([each.position], test.position, test.diagonal, rng=rng) | _counts(each, test)
        for name, each in located.items()
    }
    if test.attitude is not None and test.height is not None:
        # How far the image centre's place on the floor is from the place below the vehicle, which the method cannot know.
        values["tilt_offset_cm"] = 100 * float(np.mean(test.height * np.abs(np.tan(test.attitude[:, :2])).max(axis=1)))
    extent, picture = picture_of(mosaic)
    floor, floor_image = floor_picture(test)
    series = {f"{name}_m": each.position for name, each in located.items()}
    series |= {f"{name}_inliers": each.inliers for name, each in located.items()}
    series |= {"time_s": test.time - test.time[0], "truth_m": test.position, "area_m": test.area, "map": extent}
    seconds = np.concatenate([each.seconds for each in located.values()])
    return Record(
        experiment="homography_baseline",
        flight=train.name,
        parameters={"anchors": anchors, "seed": seed},
        values=values,
        series=series | floor,
        images={"map": picture} | floor_image,
        timings={"locate_s": {"median": np.median(seconds), "p99": np.percentile(seconds, 99)}},
        provenance=provenance(train, test),
    )


def _counts(located: Located, test: Flight) -> dict:
    """Frames without a homography, and with one that is off by more than half the width of the area."""
    error = np.hypot(*(located.position - test.position).T)
    x_min, x_max, y_min, y_max = test.area
    gross = error > min(x_max - x_min, y_max - y_min) / 2
    return {"failures": int((~located.found).sum()), "gross_errors": int(gross[located.found].sum())}
