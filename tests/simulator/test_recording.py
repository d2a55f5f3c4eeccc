"""Recorded virtual flights: bytes from the seed, truth, the folder, the command."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from trexton.base.errors import ParameterError
from trexton.cli.main import main
from trexton.flights.folder import load_folder
from trexton.simulator.floor import Floor
from trexton.simulator.recording import record_flight
from trexton.simulator.sensor import Effects
from trexton.simulator.simulator import Simulator
from trexton.vision.camera import Camera, MapImage

SMALL = Camera(160, 120, 130.0)


@pytest.fixture(scope="module")
def floor() -> Floor:
    coarse = np.random.default_rng(1).integers(0, 256, (24, 24, 3), dtype=np.uint8)
    return Floor(
        MapImage.from_extent(
            cv2.resize(coarse, (768, 768), interpolation=cv2.INTER_CUBIC), 0.0, 3.0, 256
        )
    )


def contents(folder) -> dict[str, bytes]:
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def test_equal_seeds_give_equal_bytes_and_other_seeds_another_flight(tmp_path, floor, monkeypatch):
    for place, seed, threads in (("a", 3, "1"), ("b", 3, "3"), ("c", 4, "3")):
        monkeypatch.setenv("OMP_NUM_THREADS", threads)
        record_flight(tmp_path / place / "flight", frames=6, seed=seed, floor=floor, camera=SMALL)
    first, second, other = (contents(tmp_path / place / "flight") for place in "abc")
    assert first == second
    assert first["floor.png"] == other["floor.png"]
    assert first["frames.csv"] != other["frames.csv"]
    assert first["images/000003.jpg"] != other["images/000003.jpg"]


def test_the_folder_is_a_sound_flight(tmp_path, floor):
    flight = record_flight(tmp_path / "survey", frames=10, floor=floor, camera=SMALL)
    reading = load_folder(tmp_path / "survey")
    assert not reading.faults and not reading.warnings
    assert len(flight.part("train")) == 10 and flight.area == (0.0, 3.0, 0.0, 3.0)
    assert np.allclose(np.diff(flight.time), 0.08)
    assert flight.image(0).shape == (120, 160, 3) and flight.camera == replace(
        SMALL, center=(79.5, 59.5)
    )
    assert flight.attitude.shape == (10, 3) and flight.height.shape == (10,)
    assert np.array_equal(flight.floor.image, floor.picture.image)
    assert np.allclose(flight.floor.world_from_pixel, floor.picture.world_from_pixel)


def test_the_pair_shares_a_floor_but_not_the_flight(tmp_path, floor):
    train = record_flight(tmp_path / "train", frames=5, floor=floor, camera=SMALL)
    test = record_flight(
        tmp_path / "test", pattern="waypoints", frames=5, floor=floor, camera=SMALL
    )
    assert (tmp_path / "train" / "floor.png").read_bytes() == (
        tmp_path / "test" / "floor.png"
    ).read_bytes()
    assert not np.array_equal(train.position, test.position)
    assert "test" in test.split


def test_a_flight_in_memory_is_the_one_that_would_be_written(tmp_path, floor):
    options = {"frames": 5, "seed": 4, "every": 2, "floor": floor, "camera": Camera(64, 48, 52.0)}
    for effects in (Effects(), Effects().without("jpeg")):
        written = record_flight(tmp_path, **options, effects=effects, replace=True)
        kept = record_flight(None, **options, effects=effects)
        for key in ("frame", "time", "position", "height", "attitude"):
            np.testing.assert_array_equal(getattr(kept, key), getattr(written, key))
        for flight in (kept, kept.select(np.arange(5))):
            for own, other in zip(flight.images(), written.images(), strict=True):
                np.testing.assert_array_equal(own, other)
        assert kept.split == written.split and kept.floor is None
        assert kept.data_hash == record_flight(None, **options, effects=effects).data_hash


def test_the_images_show_the_place_that_the_truth_names(tmp_path, floor):
    effects = replace(
        Effects().without(*Effects().as_dict()),
        roll_pitch=1.0,
        yaw=0.03,
        height_ripple=0.03,
    )
    flight = record_flight(
        tmp_path / "flight",
        pattern="waypoints",
        frames=4,
        every=9,
        floor=floor,
        camera=SMALL,
        effects=effects,
    )
    for row in range(len(flight)):
        position = np.array([*flight.position[row], flight.height[row]])
        matrix = np.linalg.inv(floor.picture.world_from_pixel) @ SMALL.world_from_pixel(
            position, flight.attitude[row]
        )
        expected = cv2.warpPerspective(
            floor.picture.image, matrix, (160, 120), flags=cv2.INTER_AREA | cv2.WARP_INVERSE_MAP
        )
        luma = cv2.cvtColor(expected, cv2.COLOR_BGR2YCrCb)[..., 0].astype(float)
        inside = cv2.warpPerspective(
            np.ones((768, 768), np.uint8),
            matrix,
            (160, 120),
            flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP,
        )
        seen = cv2.erode(inside, np.ones((5, 5), np.uint8)) > 0
        assert seen.mean() > 0.2
        light = flight.image(row)[..., 0].astype(float)
        assert np.corrcoef(light[seen], luma[seen])[0, 1] > 0.99


def test_the_truth_has_millimetre_noise(floor):
    simulator = Simulator(floor, camera=SMALL, rng=np.random.default_rng(0))
    state = simulator.step((2.0, 2.0))
    error = np.array([simulator.measure()[:3] for _ in range(400)]) - state.position
    assert np.abs(error.mean(axis=0)).max() < 3e-4
    assert (np.abs(error.std(axis=0) - 1e-3) < 2e-4).all()


def test_few_frames_can_cover_the_area(tmp_path, floor):
    flight = record_flight(tmp_path / "flight", frames=20, every=20, floor=floor, camera=SMALL)
    assert np.allclose(np.diff(flight.time), 1.6)
    assert (np.ptp(flight.position, axis=0) > 2.0).all()


@pytest.mark.parametrize(
    "options", [{"frames": 0}, {"every": 0}, {"seed": -1}, {"pattern": "spiral"}, {"height": 0.0}]
)
def test_nonsense_is_refused_and_nothing_is_written(tmp_path, floor, options):
    with pytest.raises(ParameterError):
        record_flight(
            tmp_path / "flight", **({"frames": 2, "floor": floor, "camera": SMALL} | options)
        )
    assert list(tmp_path.iterdir()) == []


def test_a_flight_never_replaces_the_picture_it_flies_over(tmp_path, capsys):
    picture = tmp_path / "pictures" / "hall.png"
    picture.parent.mkdir()
    cv2.imwrite(str(picture), np.zeros((50, 50, 3), np.uint8))
    words = ["simulate", "--out", str(picture.parent), "--floor", str(picture), "--replace"]
    assert main(words) == 1 and "is read here" in capsys.readouterr().err
    assert [path.name for path in picture.parent.iterdir()] == ["hall.png"]


def test_a_flight_that_breaks_off_leaves_the_old_one(tmp_path, floor, monkeypatch):
    record_flight(tmp_path / "flight", frames=2, floor=floor, camera=SMALL)
    before = contents(tmp_path / "flight")
    monkeypatch.setattr(Simulator, "capture", lambda self, moment: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        record_flight(tmp_path / "flight", frames=2, floor=floor, camera=SMALL, replace=True)
    assert contents(tmp_path / "flight") == before
    assert [path.name for path in tmp_path.iterdir()] == ["flight"]


def test_the_command_records_a_flight_over_a_picture(tmp_path, capsys):
    cv2.imwrite(
        str(tmp_path / "floor.png"),
        np.random.default_rng(0).integers(0, 256, (60, 60, 3), dtype=np.uint8),
    )
    command = [
        "simulate",
        "--out",
        str(tmp_path / "flight"),
        "--floor",
        str(tmp_path / "floor.png"),
        "--floor-width",
        "2",
    ]
    assert (
        main(
            [
                *command,
                "--frames",
                "2",
                "--set",
                "jpeg=0",
                "noise=0",
                "yaw=0.1",
                "--quiet",
            ]
        )
        == 0
    )
    names = sorted(path.name for path in (tmp_path / "flight" / "images").iterdir())
    assert names == ["000000.png", "000001.png"]
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    "arguments, message",
    [
        (["--set", "fog=1"], "no parameter 'fog'"),
        (["--set", "noise=much"], "noise is 'much': expected float"),
        (["--set", "noise"], "expected effect=value"),
        (["--set", "noise=1", "--set", "noise=2"], "--set has noise twice"),
        (["--set", "jpeg=101"], "jpeg is 101.0: expected 100 or less"),
        (["--floor-width", "5"], "without --floor"),
        (["--floor", "missing.png"], "missing.png"),
        (["--frames", "0"], "number of frames is 0: expected a whole number of at least 1"),
    ],
)
def test_the_command_says_in_one_sentence_what_is_wrong(tmp_path, capsys, arguments, message):
    assert main(["simulate", "--out", str(tmp_path / "flight"), *arguments]) == 1
    error = capsys.readouterr().err
    assert message in error and len(error.strip().splitlines()) == 1
    assert not (tmp_path / "flight").exists()
