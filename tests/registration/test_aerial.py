"""Photographs from the air with GPS that errs, over rows of containers that look alike: the map
against the truth, against photographs matched one by one, and where it must say that it is wrong.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from test_mosaic import CAMERA, lanes, links_of

from trexton.base.errors import MapError
from trexton.companion.experiments.homography import HomographyLocalizer
from trexton.flights.flight import Flight
from trexton.flights.frames import ImageFiles
from trexton.localization.localizer import Localizer
from trexton.localization.training import train_map
from trexton.registration.adjust import adjust, left_out
from trexton.registration.homography import detect_keypoints
from trexton.registration.layout import Anchors, layout_by_positions
from trexton.registration.links import match_frames
from trexton.registration.mosaic import stitch
from trexton.vision.camera import Camera, transform_points

GRAIN = 8  # pixels of the ground's picture a metre
CAMERA_ABOVE = Camera(width=320, height=240, focal=260.0)
HEIGHT, TILT, GPS, DRIFT = 40.0, np.radians(3), 2.5, 1.5  # of GPS metres, white and wandering


def yard(
    width: float, depth: float, rng: np.random.Generator, alike: float
) -> tuple[np.ndarray, np.ndarray]:
    """``(H, W, 3)`` ground with rows of containers, and where their tops are; the more `alike`, the
    less any stain tells one from the next.
    """
    size = int(depth * GRAIN), int(width * GRAIN)

    def stains(scales: tuple[int, ...]) -> np.ndarray:
        small = [
            cv2.resize(rng.normal(size=(size[0] // s + 2, size[1] // s + 2)), size[::-1])
            for s in scales
        ]
        return np.sum(small, axis=0)[..., None]

    ground = 120 + 7 * (1 - alike) * stains((2, 8, 40)) * np.ones(3)
    tops = np.zeros(size, np.uint8)
    paints = np.array([[60, 60, 150], [140, 70, 40], [150, 140, 130]])[rng.integers(0, 3, 4)]
    length, across = 12 * GRAIN, int(2.4 * GRAIN)
    ribs = 8 * np.sin(np.arange(length) / length * 40 * np.pi)[:, None]
    for top in range(10 * GRAIN, size[0] - 20 * GRAIN, 19 * GRAIN):
        for left in range(8 * GRAIN, size[1] - 20 * GRAIN, 13 * GRAIN):
            for place, paint in enumerate(paints):
                row = top + int(2.7 * GRAIN) * place
                window = slice(row, row + across), slice(left, left + length)
                ground[window] = paint + ribs + (1 - alike) * rng.normal(0, 8, 3)
                ground[row : row + 2, window[1]] = ground[window[0], left : left + 2] = 40
                tops[window] = 1
                if rng.random() < 0.35 * (1 - alike):
                    at = left + length // 4 * int(rng.integers(1, 4))
                    ground[row + 6 : row + 12, at : at + length // 8] = 205
    ground += 5 * (1 - alike) * stains((3, 10, 30))
    return np.clip(ground, 0, 255).astype(np.uint8), tops


def survey(
    folder: Path, rows: int, each: int, *, seed: int, alike: float = 0.0, relief: float = 0.0
) -> tuple[Flight, np.ndarray]:
    """A flight of photographs along lines there and back, and their true ``(N, 6)`` poses."""
    rng = np.random.default_rng(seed)
    seen = HEIGHT / CAMERA_ABOVE.focal * np.array([CAMERA_ABOVE.width, CAMERA_ABOVE.height])
    along, apart, edge = 0.35 * seen[1], 0.4 * seen[0], 1.1 * seen[0]
    depth = 2 * edge + rows * apart
    ground, tops = yard(2 * edge + each * along, depth, rng, alike)
    floor = np.where(tops[..., None] * relief > 0, 38, ground).astype(np.uint8)
    world = np.array([[1 / GRAIN, 0, 0], [0, -1 / GRAIN, depth], [0, 0, 1]])
    poses, files = [], []
    for number in range(rows * each):
        row, column = divmod(number, each)
        back = row % 2 == 1
        place = edge + (each - 1 - column if back else column) * along, edge + row * apart, HEIGHT
        pose = np.array([*place, 0, 0, np.pi / 2 if back else -np.pi / 2])
        pose += rng.normal(0, [1, 1, 0.03 * HEIGHT, TILT, TILT, 0.08])
        photograph = 0
        for picture, above in ((floor, 0.0), (ground, relief)):
            lowered = pose[:3] - (0, 0, above)
            matrix = np.linalg.solve(CAMERA_ABOVE.world_from_pixel(lowered, pose[3:]), world)
            size = (CAMERA_ABOVE.width, CAMERA_ABOVE.height)
            layer = cv2.warpPerspective(picture, matrix, size, flags=cv2.INTER_AREA)
            shown = cv2.warpPerspective(tops, matrix, size, flags=cv2.INTER_NEAREST)[..., None]
            photograph = layer if above == 0 else np.where(shown > 0, layer, photograph)
        photograph = (1 + 0.05 * rng.normal()) * photograph + rng.normal(0, 2, photograph.shape)
        folder.mkdir(exist_ok=True)
        files.append(folder / f"{number:03d}.png")
        cv2.imwrite(str(files[-1]), np.clip(photograph, 0, 255).astype(np.uint8))
        poses.append(pose)
    truth, count = np.array(poses), len(poses)
    drift = np.cumsum(rng.normal(size=(count, 2)), axis=0)
    drift = DRIFT * (drift - drift.mean(axis=0)) / drift.std()
    position = truth[:, :2] + rng.normal(0, GPS, (count, 2)) + drift
    flight = Flight(
        name="aerial", frame=np.arange(count), time=2.0 * np.arange(count), position=position,
        area=(0.0, 1000.0, 0.0, 1000.0), frames=ImageFiles(tuple(files)), camera=CAMERA_ABOVE,
        origin=(41.0, -82.0),
    )  # fmt: skip
    return flight, truth


def lengths(vectors: np.ndarray) -> np.ndarray:
    return np.hypot(*np.asarray(vectors).T)


def centers(poses: np.ndarray) -> np.ndarray:
    """``(N, 2)``: the floor in the middle of each photograph."""
    middle = [CAMERA_ABOVE.principal_point]
    return np.array(
        [
            transform_points(CAMERA_ABOVE.world_from_pixel(pose[:3], pose[3:6]), middle)[0]
            for pose in poses
        ]
    )


@pytest.fixture(scope="module")
def containers(tmp_path_factory):
    return survey(tmp_path_factory.mktemp("containers"), 4, 8, seed=4, relief=1.5)


@pytest.fixture(scope="module")
def nine(tmp_path_factory):
    return survey(tmp_path_factory.mktemp("nine"), 3, 3, seed=8)


# the parts


def test_positions_that_err_and_links_lay_frames_out_that_turn_back():
    truth = lanes()
    truth[:, 3:5] = truth[:, 6:] = 0
    truth[20:40, 5] += np.pi
    near = truth[:, :2] + np.random.default_rng(3).normal(0, 0.1, (len(truth), 2))
    links = links_of(truth, wrong=0.1)
    anchors = Anchors(np.arange(len(truth)), near, 0.1)
    start = layout_by_positions(len(truth), links, anchors, CAMERA.focal)
    off = lengths((start - truth)[:, :2])
    assert np.median(off) < 0.6 * np.median(lengths(near - truth[:, :2])) and off.max() < 0.4
    found = adjust(start, links, anchors, CAMERA.focal)
    assert lengths((found - truth)[:, :2]).max() < 0.06
    assert np.abs(np.exp(1j * found[:, 5]) - np.exp(1j * truth[:, 5])).max() < 0.04
    assert np.abs(found[:, 2] - truth[:, 2]).max() < 0.04


def test_an_anchor_left_out_is_as_far_off_as_adjusting_without_it_says():
    truth = lanes(30)
    links = links_of(truth, noise=0.5)
    rows = np.arange(0, 30, 3)
    near = truth[rows, :2] + np.random.default_rng(4).normal(0, 0.05, (len(rows), 2))
    anchors = Anchors(rows, near, 0.05)
    poses = adjust(truth, links, anchors, CAMERA.focal)
    off = left_out(poses, links, anchors, CAMERA.focal)
    for each in (0, 4, 9):
        others = anchors[np.arange(len(rows)) != each]
        without = adjust(poses, links, others, CAMERA.focal, widths=(2,))
        np.testing.assert_allclose(off[each], near[each] - without[rows[each], :2], atol=0.004)
    assert (lengths(off) > lengths(near - poses[rows, :2])).all()


# the whole


def test_over_containers_alike_the_map_is_better_than_gps_and_says_how_far_it_is_off(containers):
    flight, truth = containers
    mosaic = stitch(flight)
    assert mosaic.used.mean() > 0.8 and not mosaic.doubt
    gps = np.median(lengths(flight.position - truth[:, :2]))
    used = mosaic.used
    assert np.median(lengths((mosaic.poses[:, :2] - truth[:, :2])[used])) < 0.6 * gps
    assert np.median(lengths((centers(mosaic.poses) - centers(truth))[used])) < 0.8 * gps
    assert np.degrees(lengths(mosaic.poses[used, 3:5])).max() < 12
    # What is left out errs by GPS and the map together; what held the map seems better than it is.
    own = np.median(lengths((mosaic.poses[:, :2] - flight.position)[mosaic.anchors]))
    assert own < np.median(mosaic.left_out) and 0.7 < np.median(mosaic.left_out) / gps < 1.5


def test_photographs_of_more_pixels_are_linked_as_well_where_things_stand_up(containers, tmp_path):
    flight, truth = containers
    files = tuple(tmp_path / f"{row:03d}.png" for row in range(len(flight)))
    for small, large in zip(flight.frames.files, files, strict=True):
        cv2.imwrite(str(large), cv2.resize(cv2.imread(str(small)), (640, 480)))
    mosaic = stitch(replace(flight, frames=ImageFiles(files), camera=Camera(640, 480, 520.0)))
    assert mosaic.used.mean() > 0.8 and not mosaic.doubt
    off = lengths((mosaic.poses[:, :2] - truth[:, :2])[mosaic.used])
    assert np.median(off) < 0.8 * np.median(lengths(flight.position - truth[:, :2]))


def photo_to_photo(train: Flight, test: Flight) -> np.ndarray:
    """``(N, 2)``: each photograph by a similarity of the six others that match it nearest."""
    photographs = [each.image(row)[..., 0] for each in (train, test) for row in range(len(each))]
    keypoints = [detect_keypoints(luma, limit=1200) for luma in photographs]
    middle, result = np.array(CAMERA_ABOVE.principal_point), []
    for row in range(len(test)):
        matched = [
            (transform_points(link[0], [middle])[0] - middle, other)
            for other in range(len(train))
            if (link := match_frames(keypoints, CAMERA_ABOVE, (other, len(train) + row)))
        ]
        best = sorted(matched, key=lambda each: np.hypot(*each[0]))[:6]
        pixels = np.array([shift for shift, _ in best]) @ [1, -1j]
        places = train.position[[other for _, other in best]] @ [1, 1j]
        columns = np.column_stack([pixels, np.ones(len(best))])
        place = np.linalg.lstsq(columns, places, rcond=None)[0][1]
        result.append((place.real, place.imag))
    return np.array(result)


def test_frames_between_are_placed_as_well_as_photo_to_photo(tmp_path):
    flight, truth = survey(tmp_path / "flight", 4, 8, seed=5)
    train, test = flight.select(slice(0, None, 2)), flight.select(slice(1, None, 2))
    localizer = HomographyLocalizer(stitch(train).map)
    placed = np.array([localizer.locate(image) for image in test.images()])
    goal = centers(truth[1::2])
    assert np.isfinite(placed).all()
    off, single = (
        np.median(lengths(each - goal)) for each in (placed, photo_to_photo(train, test))
    )
    assert off <= single


def test_a_map_of_photographs_that_all_look_alike_is_in_doubt_and_fine_refuses_it(tmp_path):
    flight, _ = survey(tmp_path / "flight", 3, 6, seed=10, alike=0.97, relief=1.5)
    with pytest.raises(MapError, match="not to be trusted|contradict|matched|too near"):
        train_map(flight, method="fine", n_textons=6, rng=np.random.default_rng(1))


def test_fine_learns_from_nine_photographs_and_finds_each_by_itself(nine):
    flight, truth = nine
    fine = train_map(flight, method="fine", n_textons=6, rng=np.random.default_rng(1))
    localizer = Localizer(fine, rng=np.random.default_rng(2))
    rows = [7, 0, 4, 8, 2]  # in no order
    estimates = [localizer.step(flight.image(row)) for row in rows]
    assert not any(each.lost for each in estimates)
    off = lengths(
        [each.position - truth[row, :2] for each, row in zip(estimates, rows, strict=True)]
    )
    assert np.median(off) < np.median(lengths(flight.position - truth[:, :2])) and off.max() < 5
    grey = localizer.step(np.full((240, 320, 3), 128, np.uint8))
    assert grey.lost


def test_fewer_photographs_are_refused_by_their_number(nine):
    with pytest.raises(MapError, match="8 of 8 training frames.* 9 are needed"):
        train_map(
            nine[0].select(slice(0, 8)), method="fine", n_textons=6, rng=np.random.default_rng(1)
        )
