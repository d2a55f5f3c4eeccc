"""The view straight down: what it makes of a frame, and that training and flight share it."""

from __future__ import annotations

import importlib
import sys
from dataclasses import replace
from importlib import import_module

import cv2
import numpy as np
import pytest
from onboard_tools import CAMERA, colourful_flight, colourful_floor

from trexton.base.errors import MapError, ParameterError
from trexton.flights.aiding import Aiding
from trexton.localization.localizer import Localizer
from trexton.localization.map_files import load_map, save_map
from trexton.localization.training import for_method, train_map
from trexton.localization.view import Nadir
from trexton.vision.camera import Camera
from trexton.vision.histograms import texton_histogram

LENS = np.array([CAMERA.width, CAMERA.height, CAMERA.focal, *CAMERA.principal_point, 1.0])
PLACE = np.array([2.0, 2.0])


def seen_from(height: float, attitude: tuple[float, float, float]) -> np.ndarray:
    """What the camera would see of the colourful floor."""
    floor = colourful_floor().picture
    world = CAMERA.world_from_pixel(np.array([*PLACE, height]), np.array(attitude))
    return cv2.warpPerspective(
        floor.image, np.linalg.inv(floor.world_from_pixel) @ world, (CAMERA.width, CAMERA.height),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
    )  # fmt: skip


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    folder = tmp_path_factory.mktemp("view") / "flight"
    return colourful_flight(folder)


@pytest.fixture(scope="module")
def trained(flight):
    return train_map(flight, n_textons=6, cells=2, rng=np.random.default_rng(1), view="nadir")


@pytest.mark.parametrize(
    ("height", "attitude", "turn"),
    [
        (1.0, (0.12, 0.0, 0.0), False),
        (1.0, (0.0, -0.15, 0.0), False),
        (1.3, (0.0, 0.0, 0.0), False),
        (0.8, (0.1, 0.1, 0.0), False),
        (1.0, (0.0, 0.0, 1.9), True),
        (1.2, (-0.1, 0.08, -0.7), True),
    ],
)
def test_what_is_known_is_taken_back(height, attitude, turn):
    frame, level = seen_from(height, attitude), seen_from(1.0, (0, 0, 0))
    view = Nadir(turn=turn).with_learned(camera=LENS)
    seen = view.frame(frame, Aiding(*attitude, height=height))
    middle = np.s_[30:-30, 45:-45]  # that all of them see
    off = [np.abs(each[middle].astype(int) - level[middle]).mean() for each in (frame, seen)]
    assert off[1] < 0.5 * off[0]
    unknown = view.frame(frame, Aiding())
    assert unknown is frame


@pytest.mark.parametrize(
    "known",
    [
        Aiding(roll=1.2, pitch=0.0),
        Aiding(height=9.0),
        Aiding(height=-1.0),
        Aiding(height=0.0, roll=0.1),
        Aiding(yaw=0.5),
        Aiding(roll=np.nan, pitch=np.nan, yaw=np.nan, height=np.nan),
    ],
)
def test_what_cannot_be_taken_back_leaves_the_frame_as_it_is(known):
    frame = seen_from(1.0, (0, 0, 0))
    assert Nadir().with_learned(camera=LENS).frame(frame, known) is frame


@pytest.mark.parametrize("angle", ["roll", "pitch", "yaw"])
def test_an_angle_that_is_no_number_is_not_known(angle):
    view, frame = Nadir(turn=True).with_learned(camera=LENS), seen_from(1.0, (0, 0, 0))
    assert view.frame(frame, Aiding(**{angle: np.nan})) is frame


def test_a_frame_of_the_training_flight_is_counted_as_in_training(flight, trained):
    localizer = Localizer(trained, samples=None, rng=np.random.default_rng(2))
    for row in (0, 17, 40):
        histogram = localizer.observe(flight.image(row), aiding=flight.aiding(row))
        assert np.array_equal(histogram, trained.histograms[row])
        as_given = texton_histogram(flight.image(row), trained.alphabet, cells=2)
        assert np.array_equal(localizer.observe(flight.image(row)), as_given)
        assert not np.array_equal(histogram, as_given)


def test_it_is_kept_with_the_map_and_through_a_change_of_method(trained, tmp_path):
    again = load_map(save_map(trained, tmp_path / "map.npz"))
    assert np.array_equal(again.parts["view"].camera, trained.parts["view"].camera)
    field = for_method(again, "field", rng=np.random.default_rng(3))
    assert field.parts["view"].camera is again.parts["view"].camera


def test_a_turn_is_another_view_of_the_same_frames(flight, trained):
    turned = train_map(
        flight, n_textons=6, cells=2, rng=np.random.default_rng(1),
        **{"view": "nadir", "view.turn": "true"},
    )  # fmt: skip
    assert turned.parts["view"].turn
    assert not np.array_equal(turned.histograms, trained.histograms)


def test_a_map_in_another_view_is_not_changed_afterwards(flight):
    plain = train_map(flight, n_textons=6, rng=np.random.default_rng(1))
    for view in ("nadir", Nadir().of(flight)):
        with pytest.raises(ParameterError, match="choose it when training"):
            Localizer(plain, rng=np.random.default_rng(2), view=view)
    nadir = train_map(flight, n_textons=6, rng=np.random.default_rng(1), view="nadir")
    for other in ({"view.turn": True}, {"view": Nadir().of(flight)}):
        with pytest.raises(ParameterError, match="choose it when training"):
            Localizer(nadir, rng=np.random.default_rng(2), **other)
    own = nadir.parts["view"]
    assert Localizer(nadir, rng=np.random.default_rng(2), view=own).parts["view"] is own


@pytest.mark.parametrize("lacking", ["height", "attitude", "camera"])
def test_what_a_flight_lacks_is_named(flight, lacking):
    with pytest.raises(MapError, match=f"lacks.*{lacking}"):
        train_map(replace(flight, **{lacking: None}), rng=np.random.default_rng(1), view="nadir")


def test_attitudes_that_were_never_recorded_are_lacking(flight):
    with pytest.raises(MapError, match="lacks attitudes"):
        train_map(
            replace(flight, attitude=np.full((len(flight), 3), np.nan)),
            rng=np.random.default_rng(1), view="nadir",
        )  # fmt: skip


def test_a_camera_that_takes_other_pictures_is_refused(flight):
    with pytest.raises(MapError, match=r"are 128x96.*takes 256x192.*correct \[camera\]"):
        train_map(
            replace(flight, camera=Camera(256, 192, 208.0)), rng=np.random.default_rng(1),
            view="nadir",
        )  # fmt: skip


def test_heights_below_the_floor_are_refused(flight):
    with pytest.raises(MapError, match="not above its floor"):
        train_map(
            replace(flight, height=-flight.height), rng=np.random.default_rng(1), view="nadir"
        )


@pytest.mark.parametrize(
    ("place", "value"), [(2, np.nan), (2, 1e12), (2, 1e-310), (3, 1e9), (4, -1e300), (5, 0.0)]
)
def test_a_damaged_camera_is_refused(place, value):
    camera = LENS.copy()
    camera[place] = value
    with pytest.raises(MapError, match="nadir view's camera"):
        Nadir().with_learned(camera=camera)


def test_counts_of_a_view_of_ones_own_are_told_apart_by_its_code(flight, tmp_path, monkeypatch):
    def digest(code):
        (tmp_path / "own_view.py").write_text(code)
        monkeypatch.delitem(sys.modules, "own_view", raising=False)
        importlib.invalidate_caches()
        return import_module("own_view").Own().of(flight).flight(flight).frames.digest

    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys, "dont_write_bytecode", True)
    code = "from trexton.localization.view import Nadir\n\n\nclass Own(Nadir):\n    pass\n"
    changed = code + "\n    def frame(self, image, aiding):\n        return image\n"
    assert digest(code) == digest(code) != digest(changed)
    session = type("Own", (Nadir,), {"__module__": "builtins"})
    assert session().of(flight).flight(flight).frames.digest != digest(code)


def test_counted_histograms_are_told_apart_by_all_that_makes_them(flight):
    def digest(view, of=flight):
        return view.flight(of).frames.digest

    view = Nadir().of(flight)
    assert digest(Nadir().of(flight)) == digest(view)

    class Other(Nadir):
        """Another way to see from above."""

    others = [
        flight.frames.digest,
        digest(view, replace(flight, attitude=flight.attitude + 0.01)),
        digest(view, replace(flight, height=flight.height + 0.01)),
        digest(Nadir(turn=True).of(flight)),
        digest(view.with_learned(camera=view.camera + 1)),
        digest(Other().of(flight)),
    ]
    assert len({digest(view), *others}) == 1 + len(others)
