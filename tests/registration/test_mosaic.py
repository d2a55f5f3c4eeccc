"""The mosaic: geometry against the camera's, solvers against plain definitions, the whole against
the room.
"""

from dataclasses import replace
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from trexton.base.errors import FlightError, MapError, ParameterError
from trexton.flights.flight import Flight
from trexton.flights.frames import ImageFiles
from trexton.registration import mosaic as stitching
from trexton.registration.adjust import adjust, link_errors
from trexton.registration.homography import Keypoints
from trexton.registration.layout import (
    Anchors,
    Links,
    assemble,
    connected,
    differences,
    floor_jacobian,
    floor_points,
    layout,
    solve,
    steps,
    world_from_pixel,
)
from trexton.registration.links import match_frames
from trexton.registration.mosaic import stitch
from trexton.simulator.recording import record_flight
from trexton.simulator.sensor import Effects
from trexton.vision.camera import Camera, transform_points

CAMERA = Camera(width=320, height=240, focal=260.0)
POSE = np.array([0.3, -0.2, 1.1, 0.05, -0.08, 2.1, 0.01, -0.02])


# geometry


def test_without_rolling_shutter_a_pose_is_the_pinhole_camera(rng):
    pose = np.concatenate([POSE[:6], [0, 0]])
    pixels = rng.uniform(0, 240, (6, 2))
    expected = transform_points(CAMERA.world_from_pixel(pose[:3], pose[3:6]), pixels)
    found = floor_points(pose[None], (pixels - CAMERA.principal_point)[None], CAMERA.focal)[0]
    np.testing.assert_allclose(found, expected, atol=1e-12)
    np.testing.assert_allclose(
        transform_points(world_from_pixel(pose, CAMERA), pixels), expected, atol=1e-12
    )


def test_rolling_shutter_displaces_rows_in_proportion(rng):
    pixels = rng.uniform(0, 240, (6, 2))
    column, row = (pixels - CAMERA.principal_point).T
    moved = np.column_stack([column + POSE[6] * row, (1 + POSE[7]) * row]) + CAMERA.principal_point
    expected = transform_points(CAMERA.world_from_pixel(POSE[:3], POSE[3:6]), moved)
    np.testing.assert_allclose(
        transform_points(world_from_pixel(POSE, CAMERA), pixels), expected, atol=1e-12
    )
    offsets = (pixels - CAMERA.principal_point)[None]
    np.testing.assert_allclose(
        floor_points(POSE[None], offsets, CAMERA.focal)[0], expected, atol=1e-12
    )


def test_the_jacobian_is_the_limit_of_differences(rng):
    offsets = rng.uniform(-150, 150, (1, 5, 2))
    jacobian = floor_jacobian(POSE[None], offsets, CAMERA.focal)
    for parameter in range(8):
        step = np.zeros(8)
        step[parameter] = 1e-6
        ahead, behind = (
            floor_points((POSE + sign * step)[None], offsets, CAMERA.focal) for sign in (1, -1)
        )
        np.testing.assert_allclose(jacobian[..., parameter], (ahead - behind) / 2e-6, atol=1e-8)


# sparse matrices


def test_sparse_matrices_are_their_plain_definitions(rng):
    pairs = np.array([[0, 2], [1, 2], [0, 2]])
    blocks = rng.normal(size=(3, 4, 4))
    expected = np.zeros((8, 8))
    for (first, second), block in zip(pairs, blocks, strict=False):
        rows = [2 * first, 2 * first + 1, 2 * second, 2 * second + 1]
        for i in range(4):
            for j in range(4):
                expected[rows[i], rows[j]] += block[i, j]
    np.testing.assert_allclose(assemble(blocks, pairs, 2, 4).toarray(), expected)
    values = rng.normal(size=6)
    np.testing.assert_allclose(differences(6, 1) @ values, np.diff(values))
    np.testing.assert_allclose(differences(6, 2) @ values, np.diff(values, 2))
    assert differences(2, 2).shape == (0, 2)
    np.testing.assert_allclose(steps(6, pairs) @ values, values[pairs[:, 1]] - values[pairs[:, 0]])
    assert connected(5, np.array([[0, 1], [3, 4]])).tolist() == [0, 0, 1, 2, 2]


def test_solve_takes_real_and_complex_right_sides(rng):
    from scipy import sparse

    root = rng.normal(size=(7, 7))
    matrix = root @ root.T + np.eye(7)
    vector = rng.normal(size=7) + 1j * rng.normal(size=7)
    for right in (vector, vector.real):
        np.testing.assert_allclose(
            solve(sparse.csr_array(matrix), right), np.linalg.solve(matrix, right)
        )


# layout and adjustment, on links made from known poses


def lanes(count: int = 60) -> np.ndarray:
    """``(count, 8)`` true poses: three lanes at about a metre, tilted, with rolling shutter."""
    rng = np.random.default_rng(5)
    phase = np.linspace(0, 3, count, endpoint=False)
    along = np.where(phase.astype(int) % 2 == 0, phase % 1, 1 - phase % 1)
    poses = np.zeros((count, 8))
    poses[:, 0], poses[:, 1], poses[:, 2] = (
        3 * along,
        0.5 * phase.astype(int),
        1 + rng.normal(0, 0.02, count),
    )
    poses[:, 3:5], poses[:, 5] = rng.normal(0, 0.04, (count, 2)), rng.normal(0, 0.02, count)
    poses[:, 6:] = rng.normal(0, 0.01, (count, 2))
    return poses


def links_of(poses: np.ndarray, noise: float = 0.0, wrong: float = 0.0) -> Links:
    """Links of all pairs that overlap well: floor points as both frames see them, plus noise in
    pixels.
    """
    pixel_from_floor = [np.linalg.inv(world_from_pixel(pose, CAMERA)) for pose in poses]
    rng = np.random.default_rng(6)
    pairs, points = [], []
    for first in range(len(poses)):
        for second in range(first + 1, len(poses)):
            apart = np.abs(poses[first, :2] - poses[second, :2])
            if (apart < (0.8, 0.6)).all() and (second - first < 4 or second % 3 == 0):
                middle = (poses[first, :2] + poses[second, :2]) / 2
                floor = middle + rng.uniform(-0.3, 0.3, (12, 2))
                seen = [transform_points(pixel_from_floor[row], floor) for row in (first, second)]
                pairs.append((first, second))
                points.append(
                    np.array(seen) - CAMERA.principal_point + rng.normal(0, noise, (2, 12, 2))
                )
    pairs, points = np.array(pairs), np.array(points)
    bad = rng.random(len(pairs)) < wrong
    points[bad, 1] += rng.uniform(30, 60, (bad.sum(), 1, 2))
    return Links(pairs, points)


def anchors_of(poses: np.ndarray, count: int = 8) -> Anchors:
    rows = np.linspace(0, len(poses) - 1, count).astype(int)
    return Anchors(rows, poses[rows, :2])


def test_layout_recovers_level_frames_exactly():
    truth = lanes()
    truth[:, 3:5] = truth[:, 6:] = 0
    truth[:, 2] = 1.0
    found = layout(len(truth), links_of(truth), anchors_of(truth), CAMERA.focal)
    np.testing.assert_allclose(found[:, [0, 1, 2, 5]], truth[:, [0, 1, 2, 5]], atol=1e-3)


def test_layout_of_tilted_frames_is_near_enough_to_start_from():
    truth = lanes()
    found = layout(len(truth), links_of(truth, wrong=0.05), anchors_of(truth), CAMERA.focal)
    assert np.hypot(*(found - truth)[:, :2].T).max() < 0.3 and np.abs(found[:, 2] - 1).max() < 0.2


def test_layout_refuses_anchors_that_lie_together():
    truth = lanes(12)
    truth[:, :2] *= 0.02
    with pytest.raises(MapError, match="too near"):
        layout(len(truth), links_of(truth), anchors_of(truth, 3), CAMERA.focal)


@pytest.mark.parametrize(
    "noise, wrong, limit", [(0.0, 0.0, 0.008), (0.5, 0.0, 0.01), (0.5, 0.1, 0.012)]
)
def test_adjustment_recovers_tilted_frames_and_shrugs_off_wrong_links(noise, wrong, limit):
    truth = lanes()
    links, anchors = links_of(truth, noise, wrong), anchors_of(truth)
    found = adjust(layout(len(truth), links, anchors, CAMERA.focal), links, anchors, CAMERA.focal)
    assert np.sqrt(((found - truth)[:, :3] ** 2).mean(axis=0)).max() < limit
    assert np.abs(np.degrees(found - truth)[:, 3:6]).mean() < 0.5
    errors = link_errors(found, links, CAMERA.focal)
    assert (errors < 3).mean() == pytest.approx(1 - wrong, abs=0.05)


def test_noise_does_not_shrink_the_map():
    truth = lanes()
    links = links_of(truth, noise=2.0)
    ends = Anchors(np.array([0, 30, 59]), truth[[0, 30, 59], :2])
    found = adjust(layout(len(truth), links, ends, CAMERA.focal), links, ends, CAMERA.focal)
    assert found[:, 2].mean() == pytest.approx(truth[:, 2].mean(), rel=0.01)


# matching


def test_matching_looks_only_within_reach_of_the_prediction(rng):
    """A tiled floor: the same 40 points every 50 pixels, displaced by 12 pixels between the
    frames.
    """
    tile = rng.uniform(0, 50, (40, 2))
    words = rng.integers(0, 200, (40, 128)).astype(np.float32)
    places = [(column, row) for column in range(0, 300, 50) for row in range(0, 200, 50)]
    points = np.concatenate([tile + place for place in places])
    first = Keypoints(points, np.tile(words, (len(places), 1)))
    second = Keypoints(points + (12.0, 5.0), first.descriptors)
    assert (
        match_frames([first, second], CAMERA, (0, 1)) is None
    )  # every match is as good as its neighbours
    homography, found = match_frames([first, second], CAMERA, (0, 1), np.eye(3), 20.0)
    np.testing.assert_allclose(
        homography / homography[2, 2], [[1, 0, 12], [0, 1, 5], [0, 0, 1]], atol=1e-3
    )
    np.testing.assert_allclose(found[1] - found[0], np.tile((12.0, 5.0), (len(found[0]), 1)))


def test_frames_of_different_floors_do_not_match(rng):
    points = rng.uniform(0, 240, (2, 100, 2))
    words = rng.integers(0, 200, (2, 100, 128)).astype(np.float32)
    first, second = (Keypoints(*each) for each in zip(points, words, strict=False))
    assert match_frames([first, second], CAMERA, (0, 1)) is None
    assert match_frames([Keypoints(points[0, :3], words[0, :3]), second], CAMERA, (0, 1)) is None


# the whole, in the virtual room


@pytest.fixture(scope="module", params=["level", "tilted"])
def flight(request, tmp_path_factory) -> Flight:
    effects = Effects().without("roll_pitch") if request.param == "level" else Effects()
    folder = tmp_path_factory.mktemp(request.param) / "flight"
    return record_flight(folder, frames=65, every=2, camera=CAMERA, effects=effects, speed=0.9)


def frame_errors(mosaic, flight: Flight) -> np.ndarray:
    """``(U,)`` metres: mean distance of a grid over each used frame from where the camera truly saw
    it.
    """
    grid = np.stack(np.meshgrid([20, 160, 300], [20, 120, 220]), axis=-1).reshape(-1, 2)
    result = []
    for row in np.flatnonzero(mosaic.used):
        place = np.append(flight.position[row], flight.height[row])
        truth = transform_points(CAMERA.world_from_pixel(place, flight.attitude[row]), grid)
        found = transform_points(world_from_pixel(mosaic.poses[row], CAMERA), grid)
        result.append(np.hypot(*(found - truth).T).mean())
    return np.array(result)


def test_the_mosaic_lies_where_the_floor_is(flight):
    mosaic = stitch(flight, anchors=8)
    assert mosaic.used.mean() > 0.95 and len(mosaic.anchors) == 8
    assert np.median(mosaic.errors) < 1.0
    assert np.median(frame_errors(mosaic, flight)) < 0.03
    # The picture itself: patches of it against the true floor, brought to the same pixels by
    # OpenCV.
    image, mask = mosaic.map.image, mosaic.map.mask
    true_from_map = np.linalg.inv(flight.floor.world_from_pixel) @ mosaic.map.world_from_pixel
    flags = cv2.INTER_AREA | cv2.WARP_INVERSE_MAP
    truth = cv2.warpPerspective(flight.floor.image, true_from_map, image.shape[1::-1], flags=flags)
    shifts, hanning = [], cv2.createHanningWindow((96, 96), cv2.CV_32F)
    for row in range(0, image.shape[0] - 96, 48):
        for column in range(0, image.shape[1] - 96, 48):
            window = slice(row, row + 96), slice(column, column + 96)
            if mask[window].all():
                pair = [cv2.cvtColor(each[window], cv2.COLOR_BGR2GRAY) for each in (image, truth)]
                shift, response = cv2.phaseCorrelate(*map(np.float32, pair), hanning)
                if response > 0.3:
                    shifts.append(np.hypot(*shift))
    metres = np.array(shifts) * np.hypot(*mosaic.map.world_from_pixel[:2, 0])
    assert len(metres) > 20 and np.median(metres) < 0.015


@pytest.fixture(scope="module")
def of_forty(flight):
    """The mosaic of the first frames."""
    return stitch(flight.select(slice(0, 40)), anchors=4)


@pytest.mark.parametrize("flight", ["tilted"], indirect=True, scope="module")
def test_only_images_and_the_anchors_positions_enter(flight, of_forty):
    part, mosaic = flight.select(slice(0, 40)), of_forty
    elsewhere = np.full_like(part.position, np.nan)
    elsewhere[mosaic.anchors] = part.position[mosaic.anchors]
    bare = replace(part, position=elsewhere, height=None, attitude=None, floor_file=None)
    again = stitch(bare, anchors=4)
    np.testing.assert_array_equal(again.anchors, mosaic.anchors)
    np.testing.assert_array_equal(again.poses, mosaic.poses)
    np.testing.assert_array_equal(again.map.image, mosaic.map.image)


@pytest.mark.parametrize("flight", ["tilted"], indirect=True, scope="module")
def test_positions_on_earth_all_place_the_map(flight):
    part = replace(flight.select(slice(0, 40)), origin=(41.2, -82.9))
    mosaic = stitch(part)
    assert len(mosaic.anchors) == mosaic.used.sum() > 35
    assert len(stitch(part, anchors=4).anchors) == 4  # who chooses is taken at their word
    assert np.median(np.hypot(*(mosaic.poses[:, :2] - part.position).T)) < 0.03


@pytest.mark.parametrize("flight", ["tilted"], indirect=True, scope="module")
def test_thread_counts_do_not_change_a_bit(flight, of_forty):
    from threadpoolctl import threadpool_limits

    part, before = flight.select(slice(0, 40)), cv2.getNumThreads()
    found = [of_forty]
    other = 2 if before == 1 else 1
    try:
        cv2.setNumThreads(other)
        with threadpool_limits(other):
            found.append(stitch(part, anchors=4))
    finally:
        cv2.setNumThreads(before)
    np.testing.assert_array_equal(found[0].poses, found[1].poses)
    np.testing.assert_array_equal(found[0].map.image, found[1].map.image)


def test_an_unknown_camera_costs_little(flight):
    part = flight.select(slice(0, 40))
    mosaic = stitch(replace(part, camera=None), anchors=5)
    assert np.median(frame_errors(mosaic, part)) < 0.06


def test_a_finer_map_has_more_pixels_and_blank_floor_is_masked(flight, monkeypatch):
    part = flight.select(slice(0, 30))
    monkeypatch.setattr(stitching, "_REACHES", ())
    maps = []
    for grain in (0.25, 0.5):
        monkeypatch.setattr(stitching, "_GRAIN", grain)
        maps.append(stitch(part, anchors=3).map)
    coarse, fine = maps
    assert fine.image.shape[0] == pytest.approx(2 * coarse.image.shape[0], abs=2)
    assert (
        not coarse.mask.all()
        and (coarse.image[~coarse.mask] == 0).all()
        and coarse.mask.mean() > 0.3
    )


# what cannot be stitched


@pytest.mark.parametrize("flight", ["tilted"], indirect=True, scope="module")
def test_where_half_size_leaves_frames_out_full_size_is_tried(flight, monkeypatch):
    tried = []

    def half_fails(flight, camera, anchors, scale, keypoints, *_):
        tried.append((scale, keypoints))
        if scale < 1:
            raise MapError("no links")
        return SimpleNamespace(used=np.ones(3, bool), doubt="")

    monkeypatch.setattr(stitching, "_stitched", half_fails)
    assert stitch(flight).used.all() and tried == [(0.5, 600), (1.0, 2000)]


@pytest.mark.parametrize("flight", ["tilted"], indirect=True, scope="module")
def test_too_few_anchors_are_named(flight):
    with pytest.raises(ParameterError, match="anchors is 2"):
        stitch(flight.select(slice(0, 12)), anchors=2)


@pytest.mark.parametrize("flight", ["tilted"], indirect=True, scope="module")
def test_flights_that_cannot_be_stitched_say_why(flight, tmp_path, monkeypatch):
    part = flight.select(slice(0, 12))
    with pytest.raises(FlightError, match="no images"):
        stitch(replace(part, frames=None))
    with pytest.raises(FlightError, match="320x240"):
        stitch(replace(part, camera=Camera()))
    with pytest.raises(FlightError, match="position"):
        stitch(replace(part, position=np.full((12, 2), np.nan)))
    with monkeypatch.context() as patched, pytest.raises(MapError, match="more anchors"):
        patched.setattr(stitching, "_GRAIN", 5000.0)
        stitch(part, anchors=3)
    grey = tmp_path / "grey.png"
    cv2.imwrite(str(grey), np.full((240, 320, 3), 120, np.uint8))
    with pytest.raises(MapError, match="texture"):
        stitch(replace(part, frames=ImageFiles((grey,) * 12)))
