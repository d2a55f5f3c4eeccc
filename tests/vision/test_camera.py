"""What an import does to images is kept, and done to a camera's in flight."""

from __future__ import annotations

import threading
from dataclasses import replace

import cv2
import numpy as np
import pytest
from onboard_flying import Film
from onboard_tools import colourful_floor

from trexton.base.errors import ImageError, MapError, ParameterError
from trexton.cli.main import main
from trexton.flights.folder import read_flight
from trexton.flights.importing import import_flight
from trexton.flights.writing import write_flight
from trexton.localization.localizer import Localizer
from trexton.localization.map_files import load_map, save_map
from trexton.localization.training import train_map
from trexton.onboard.build import build
from trexton.onboard.loop import Onboard
from trexton.onboard.settings import Flying, Settings
from trexton.onboard.sources import open_source
from trexton.simulator.recording import record_flight
from trexton.vision.camera import Camera, Rectification
from trexton.vision.images import yuv_from_bgr

LENS = (-0.28, 0.09, 0.0, 0.0)
CAMERA = Camera(256, 192, 190.0)
SMALL = Rectification((256, 192), (16, 12, 224, 168), (112, 84), 190.0, (127.5, 95.5), LENS)


def bent(image: np.ndarray) -> np.ndarray:
    """The picture as a lens with that distortion would take it."""
    matrix = np.array([[190.0, 0, 127.5], [0, 190.0, 95.5], [0, 0, 1]])
    pixels = np.indices((192, 256))[::-1].reshape(2, -1).T.astype(np.float32)
    straight = cv2.undistortPoints(pixels[:, None], matrix, np.array(LENS), P=matrix)
    maps = straight.reshape(192, 256, 2).astype(np.float32)
    return cv2.remap(image, maps, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A table of positions beside distorted pictures, and a calibration; and the flight."""
    folder = tmp_path_factory.mktemp("raw")
    flight = record_flight(
        folder / "sim", frames=120, every=3, camera=CAMERA, floor=colourful_floor()
    )
    (folder / "images").mkdir()
    rows = ["image,t,x,y"]
    for row, file in enumerate(flight.frames.files):
        cv2.imwrite(str(folder / "images" / f"{row:03d}.png"), bent(cv2.imread(str(file))))
        x, y = flight.position[row]
        rows.append(f"{row:03d}.png,{flight.time[row]},{x},{y}")
    (folder / "images" / "positions.csv").write_text("\n".join(rows) + "\n")
    storage = cv2.FileStorage(str(folder / "lens.yml"), cv2.FILE_STORAGE_WRITE)
    for name, value in (
        ("image_width", 256), ("image_height", 192),
        ("camera_matrix", np.array([[190.0, 0, 127.5], [0, 190, 95.5], [0, 0, 1]])),
        ("distortion_coefficients", np.array([LENS])),
    ):  # fmt: skip
        storage.write(name, value)
    storage.release()
    return folder


@pytest.fixture(scope="module")
def imported(place):
    return import_flight(
        place / "images" / "positions.csv", place / "flight", kind="csv",
        settings={
            "image": "image", "time": "t", "undistort": str(place / "lens.yml"),
            "crop": "16,12,224,168", "scale": 0.5,
        },
    )[0]  # fmt: skip


def test_what_an_import_did_is_kept_with_the_flight_and_the_map(imported, tmp_path):
    assert imported.rectification == SMALL
    assert imported.camera == Camera(112, 84, 95.0, (55.5, 41.5))  # the calibration's
    again = read_flight(write_flight(imported, tmp_path / "again"))
    assert (
        again.rectification == SMALL
        and again.data_hash != replace(again, rectification=None).data_hash
    )
    texton_map = train_map(again, n_textons=8, rng=np.random.default_rng(1))
    assert load_map(save_map(texton_map, tmp_path / "map.npz")).rectification == SMALL


def test_where_a_lens_is_undistorted_the_camera_is_the_calibrations():
    for known in (None, Camera(256, 192, 150.0, (120.0, 90.0)), Camera(640, 480, 400.0)):
        assert SMALL.camera(known) == Camera(112, 84, 95.0, (55.5, 41.5))
    assert replace(SMALL, distortion=()).camera(Camera(640, 480, 400.0)) is None


def test_a_raw_picture_becomes_what_was_imported(place, imported):
    raw = yuv_from_bgr(cv2.imread(str(place / "images" / "007.png")))
    mine, written = SMALL.apply(raw).astype(int), imported.image(7).astype(int)
    assert mine.shape == written.shape == (84, 112, 3)
    assert np.abs(mine - written).mean() < 2.5  # of the JPEG that was written


def fly(place, path, pictures, *outputs):
    """Over a camera of these pictures, which is none of a flight's."""
    words = {Flying: Flying(camera=str(place / "flight"))}
    built, camera = build(Settings(str(path), outputs, (), words)), Film(pictures)
    camera.rectification = SMALL
    return Onboard(built.localizer, camera, built.sinks, tally=built.tally)


def test_a_camera_is_seen_as_it_was_when_the_map_was_made(place, imported, tmp_path):
    """Raw pictures lead to the places that imported ones lead to; before, each was of a wrong
    size."""
    texton_map = train_map(imported, n_textons=8, rng=np.random.default_rng(1))
    path, table = save_map(texton_map, tmp_path / "map.npz"), tmp_path / "raw.csv"
    words = {Flying: Flying(camera="/dev/video0")}
    assert build(Settings(str(path), (), (), words)).source.rectification == SMALL
    files = sorted((place / "images").glob("*.png"))
    raw = [yuv_from_bgr(cv2.imread(str(file))) for file in files]
    fly(place, path, raw, f"csv:{table}").run(threading.Event())
    rows = np.genfromtxt(table, delimiter=",", names=True, dtype=None, encoding="utf-8")
    assert (rows["observed"] == 1).all()
    localizer = Localizer(texton_map, rng=np.random.default_rng(2))
    expected = np.array([localizer.step(image).position for image in imported.images()])
    found = np.column_stack([rows["x_m"], rows["y_m"]])
    off = [np.hypot(*(each - imported.position)[30:].T).mean() for each in (found, expected)]
    assert off[0] < 1.3 * off[1] + 0.05


def test_cameras_are_asked_for_their_own_size_and_recordings_left_as_they_are(
    place, imported, tmp_path, capsys
):
    """A camera that gives the map's size has its lens still, and its frames show other places."""
    texton_map = train_map(imported, n_textons=8, rng=np.random.default_rng(1))
    path = save_map(texton_map, tmp_path / "map.npz")
    raw = yuv_from_bgr(cv2.imread(str(place / "images" / "007.png")))
    onboard = fly(place, path, [raw, imported.image(7)])
    seen = []
    onboard.source.watch = seen.append
    summary = onboard.run(threading.Event())
    assert [frame.picture.shape for frame in seen] == [(84, 112, 3)] * 2
    assert summary["observed"] == 1 and summary["faults"] == {"size": 1}
    assert "frames of 112x84, and a map of 256x192: set the camera" in capsys.readouterr().err
    assert open_source(str(place / "flight")).rectified
    assert not open_source("/dev/video0").rectified
    with pytest.raises(ImageError, match="apply the map's rectification"):
        Localizer(texton_map, rng=np.random.default_rng(2)).step(raw)


def test_images_of_another_size_than_it_makes_train_no_map_that_cannot_be_read(imported):
    other = replace(imported, rectification=replace(SMALL, size=(56, 42)))
    with pytest.raises(MapError, match="images of 112x84 pixels, its .rectification. makes 56x42"):
        train_map(other, n_textons=8, rng=np.random.default_rng(1))
    histograms = np.full((len(imported), 8), 1 / 8)
    bare = replace(imported, frames=None, histograms=histograms)
    assert train_map(bare, rng=np.random.default_rng(1)).rectification is None


def test_an_import_that_changes_nothing_keeps_nothing(place):
    flight, _ = import_flight(
        place / "images" / "positions.csv", place / "plain", kind="csv",
        settings={"image": "image", "time": "t"},
    )  # fmt: skip
    assert flight.rectification is None
    assert "rectification" not in (place / "plain" / "flight.toml").read_text()


@pytest.mark.parametrize(
    "change",
    [
        {"source": (0, 192)}, {"crop": (40, 12, 224, 168)}, {"crop": (0, 0, 1, 0)},
        {"size": (112.5, 84)}, {"focal": 0.0}, {"focal": np.nan}, {"distortion": (1.0, 2.0)},
        {"center": (np.inf, 0.0)}, {"size": (10**6, 84)}, {"source": (256, 192, 3)},
        {"crop": (16, 12, 224)}, {"size": (112,)}, {"focal": "190"}, {"focal": 10**400},
        {"center": (1.0,)}, {"distortion": ("a",) * 4}, {"distortion": (LENS,) * 4},
    ],
)  # fmt: skip
def test_what_cannot_be_is_refused(change):
    with pytest.raises(ParameterError, match="expected"):
        replace(SMALL, **change)


@pytest.mark.parametrize("broken", [{}, {"source_px": 3}, SMALL.table() | {"more": 1}])
def test_a_table_that_is_none_is_refused(broken):
    with pytest.raises(ParameterError, match="expected source_px"):
        Rectification.from_table(broken)


def test_a_header_that_is_wrong_is_named(imported, tmp_path, capsys):
    path = write_flight(imported, tmp_path / "broken")
    header = path / "flight.toml"
    header.write_text(header.read_text().replace("crop_px = [16, 12,", "crop_px = [99, 12,"))
    assert main(["check", str(path)]) == 1
    assert "[rectification]: images of (256, 192) pixels cropped" in capsys.readouterr().out
