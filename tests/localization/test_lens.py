"""The camera and its usual height, as parts learn them of a flight and read them of a map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from onboard_tools import CAMERA, colourful_flight

from trexton.base.errors import FlightError, MapError
from trexton.localization.lens import camera_of, check_lens, learned_lens, lens_of
from trexton.vision.camera import Camera

LENS = np.array([CAMERA.width, CAMERA.height, CAMERA.focal, *CAMERA.principal_point, 1.0])


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    return colourful_flight(tmp_path_factory.mktemp("lens") / "flight")


def test_a_lens_is_a_camera_and_its_usual_height(flight):
    lens = learned_lens(flight, "go without")
    assert camera_of(lens) == (flight.camera, np.median(flight.height))
    np.testing.assert_array_equal(lens_of(*camera_of(lens)), lens)
    check_lens(lens, "a")


@pytest.mark.parametrize("lacking", ["height", "camera"])
def test_what_a_flight_lacks_is_named(flight, lacking):
    with pytest.raises(MapError, match=f"lacks.*{lacking}.*or go without"):
        learned_lens(replace(flight, **{lacking: None}), "go without")


def test_a_camera_that_takes_other_pictures_is_refused(flight):
    with pytest.raises(FlightError, match=r"are 128x96.*takes 256x192.*correct \[camera\]"):
        learned_lens(replace(flight, camera=Camera(256, 192, 208.0)), "go without")


def test_heights_below_the_floor_are_refused(flight):
    with pytest.raises(MapError, match="lacks the camera's heights above the floor"):
        learned_lens(replace(flight, height=-flight.height), "go without")


@pytest.mark.parametrize(
    ("place", "value"), [(2, np.nan), (2, 1e12), (2, 1e-310), (3, 1e9), (4, -1e300), (5, 0.0)]
)
def test_a_damaged_camera_is_refused(place, value):
    camera = LENS.copy()
    camera[place] = value
    with pytest.raises(MapError, match="an odometry's camera"):
        check_lens(camera, "an odometry's")
