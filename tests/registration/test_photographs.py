"""Registration on real photographs from the air, against SIFT on the same stitched map."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from trexton.companion.experiments.homography import HomographyLocalizer
from trexton.flights.flight import Flight
from trexton.flights.frames import ImageFiles
from trexton.localization.lens import flight_camera
from trexton.registration import mosaic as stitching
from trexton.registration.mosaic import stitch
from trexton.registration.tracker import FloorTracker
from trexton.registration.trust import Trust

FOLDER = Path(os.environ.get("TREXTON_DATA", "../shared/data")) / "seneca"


@pytest.fixture(scope="module")
def photographs() -> Flight:
    if not (FOLDER / "positions.csv").is_file():
        pytest.skip(f"{FOLDER}: no photographs there")
    with open(FOLDER / "positions.csv", newline="") as stream:
        rows = list(csv.DictReader(stream))
    place = np.array([(float(row["x_east_m"]), float(row["y_north_m"])) for row in rows])
    (x_min, y_min), (x_max, y_max) = place.min(axis=0), place.max(axis=0)
    return Flight(
        name="seneca",
        frame=np.arange(len(rows)),
        time=np.arange(len(rows), dtype=float),
        position=place,
        area=(x_min, x_max, y_min, y_max),
        frames=ImageFiles(tuple(FOLDER / "images" / row["file"] for row in rows)),
    )


@pytest.mark.slow
def test_each_by_itself_as_many_are_right_as_with_sift(photographs, monkeypatch):
    odd, even = photographs.select(slice(1, None, 2)), photographs.select(slice(0, None, 2))
    monkeypatch.setattr(stitching, "_SEARCHES", ((1.0, 1200),))
    mosaic = stitch(odd, anchors=40)
    height = float(np.median(mosaic.poses[mosaic.used, 2]))
    sift = HomographyLocalizer(mosaic.map)
    tracker = FloorTracker(mosaic.map, flight_camera(odd), height, trust=Trust(least=0.2))
    errors = []
    for row, place in enumerate(even.position):
        image = even.image(row)
        tracker.reset()
        found = (tracker.step(image).position, sift.locate(image))
        errors.append([np.hypot(*(position - place)) for position in found])
    registered, homography = np.array(errors).T
    for tolerance in (10, 15, 20, 30):  # metres; the positions come from a plain GPS receiver
        assert (registered < tolerance).sum() >= (homography < tolerance).sum() > 0
