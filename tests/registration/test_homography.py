"""Frames rendered from a known place over a known floor must be found there."""

import cv2
import numpy as np
import pytest

from trexton.base.errors import ImageError, MapError, ParameterError
from trexton.companion.experiments.homography import HomographyLocalizer
from trexton.registration.homography import detect_keypoints, find_homography
from trexton.vision.camera import Camera, MapImage, transform_points
from trexton.vision.images import yuv_from_bgr

CAMERA = Camera(width=320, height=240, focal=260.0)
PIXELS_PER_METRE = 280


def painted(side: int = 840) -> np.ndarray:
    """A floor of blobs of many sizes: keypoints everywhere, no two alike."""
    rng = np.random.default_rng(3)
    total = np.zeros((side, side, 3))
    for cells in (20, 60, 180):
        total += cv2.resize(
            rng.normal(size=(cells, cells, 3)), (side, side), interpolation=cv2.INTER_CUBIC
        )
    return np.clip(128 + 40 * total, 0, 255).astype(np.uint8)


def view(floor: MapImage, position, attitude=(0.0, 0.0, 0.0)) -> np.ndarray:
    """What the camera sees, by OpenCV's own warp."""
    world_from_view = CAMERA.world_from_pixel(np.array(position), np.array(attitude))
    seen = np.linalg.inv(floor.world_from_pixel) @ world_from_view
    size = (CAMERA.width, CAMERA.height)
    image = cv2.warpPerspective(
        floor.image, seen, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    )
    return yuv_from_bgr(image)


@pytest.fixture(scope="module")
def floor() -> MapImage:
    return MapImage.from_extent(painted(), -1.5, 1.5, PIXELS_PER_METRE)


@pytest.fixture(scope="module")
def localizers(floor) -> dict[float, HomographyLocalizer]:
    """By scale."""
    return {scale: HomographyLocalizer(floor, scale=scale) for scale in (1.0, 0.5)}


@pytest.fixture(scope="module")
def localizer(localizers) -> HomographyLocalizer:
    return localizers[1.0]


POSES = [
    ((0.0, 0.0, 1.0), (0.0, 0.0, 0.0)),
    ((0.6, -0.4, 1.05), (0.0, 0.0, 0.1)),
    ((-0.5, 0.3, 0.95), (0.05, -0.04, 0.0)),
    ((0.2, 0.5, 1.0), (-0.06, 0.08, 3.0)),
]


@pytest.mark.parametrize("scale", [1.0, 0.5])
@pytest.mark.parametrize("position, attitude", POSES)
def test_the_fix_is_the_floor_point_of_the_frames_centre(
    floor, localizers, position, attitude, scale
):
    chosen = localizers[scale]
    frame = view(floor, position, attitude)
    center = [[(CAMERA.width - 1) / 2, (CAMERA.height - 1) / 2]]
    expected = transform_points(
        CAMERA.world_from_pixel(np.array(position), np.array(attitude)), center
    )[0]
    assert chosen.match(frame)[1].sum() > 20
    np.testing.assert_allclose(chosen.locate(frame), expected, atol=0.005)


def test_tilt_is_an_error_that_the_method_cannot_see(floor, localizer):
    roll = 0.05
    x, y = localizer.locate(view(floor, (0.0, 0.0, 1.0), (roll, 0.0, 0.0)))
    assert abs(abs(x) - np.tan(roll)) < 0.005 and abs(y) < 0.005


def test_the_whole_homography_agrees_not_only_its_centre(floor, localizer):
    position, attitude = POSES[3]
    homography, _ = localizer.match(view(floor, position, attitude))
    corners = np.array([[0, 0], [319, 0], [319, 239], [0, 239]])
    truth = CAMERA.world_from_pixel(np.array(position), np.array(attitude))
    found = floor.to_world(transform_points(homography, corners))
    np.testing.assert_allclose(found, transform_points(truth, corners), atol=0.01)


def test_a_blank_frame_matches_nothing_and_has_no_position(localizer):
    blank = np.full((240, 320, 3), 128, np.uint8)
    homography, inliers = localizer.match(blank)
    assert homography is None and not len(inliers) and np.isnan(localizer.locate(blank)).all()


def test_nothing_is_filtered_a_foreign_frame_gets_what_its_homography_says(localizer):
    rng = np.random.default_rng(9)
    noise = cv2.GaussianBlur(rng.integers(0, 256, (240, 320, 3), dtype=np.uint8), (0, 0), 2)
    frame = cv2.normalize(noise, None, 0, 255, cv2.NORM_MINMAX)
    homography, inliers = localizer.match(frame)
    assert (homography is not None) == np.isfinite(localizer.locate(frame)).all()
    assert inliers.sum() < 12  # its weakness shows in the count, not in its absence


def test_a_second_localizer_and_other_threads_give_the_same_bits(floor):
    frames = [view(floor, *pose) for pose in POSES]
    before, found = cv2.getNumThreads(), []
    try:
        for threads in (1, 2, 2):
            cv2.setNumThreads(threads)
            localizer = HomographyLocalizer(floor)
            found.append(
                [(localizer.locate(each).tobytes(), *localizer.match(each)[1]) for each in frames]
            )
    finally:
        cv2.setNumThreads(before)
    assert found[0] == found[1] == found[2]


def test_the_order_of_frames_does_not_matter(floor, localizer):
    frames = [view(floor, *pose) for pose in POSES]
    forward = [localizer.locate(frame) for frame in frames]
    backward = [localizer.locate(frame) for frame in reversed(frames)][::-1]
    np.testing.assert_array_equal(forward, backward)


def test_unmapped_floor_gives_no_keypoints(floor):
    mask = np.zeros(floor.image.shape[:2], bool)
    mask[:, :420] = True
    half = HomographyLocalizer(MapImage(floor.image, floor.world_from_pixel, mask))
    assert half.match(view(floor, (-0.7, 0.0, 1.0)))[1].sum() > 20
    assert half.match(view(floor, (0.8, 0.0, 1.0)))[1].sum() < 12


def test_keypoints_of_a_smaller_scale_are_given_in_pixels_of_the_whole_image():
    image = np.full((200, 300), 90, np.uint8)
    blobs = [(60.0, 50.0), (200.0, 120.0), (110.0, 150.0)]
    rows, columns = np.mgrid[:200, :300]
    for x, y in blobs:
        image += (120 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * 6.0**2))).astype(
            np.uint8
        )
    for scale in (1.0, 0.5, 0.4):
        points = detect_keypoints(image, scale=scale).points
        for blob in blobs:
            assert np.hypot(*(points - blob).T).min() < 0.1


def test_the_strongest_keypoints_are_kept(floor):
    luma = cv2.cvtColor(floor.image, cv2.COLOR_BGR2GRAY)
    everything, few = detect_keypoints(luma), detect_keypoints(luma, limit=50)
    assert len(few) == 50 < len(everything)
    assert {tuple(point) for point in few.points} <= {tuple(point) for point in everything.points}


def test_find_homography_survives_outliers_and_refuses_too_little(rng):
    truth = np.array([[1.1, 0.05, 20], [-0.03, 0.95, -10], [1e-4, -5e-5, 1]])
    source = rng.uniform(0, 300, (80, 2))
    target = transform_points(truth, source)
    target[:30] += rng.uniform(20, 100, (30, 2))
    homography, inliers = find_homography(source, target, 3.0)
    assert inliers[30:].all() and inliers[:30].sum() <= 2
    expected = transform_points(truth, source)
    np.testing.assert_allclose(transform_points(homography, source), expected, atol=0.05)
    for few in (source[:0], source[:3]):
        homography, inliers = find_homography(few, few, 3.0)
        assert homography is None and len(inliers) == len(few)


@pytest.mark.parametrize("wrong", [0, 1.5])
def test_a_scale_out_of_range_is_named(floor, wrong):
    with pytest.raises(ParameterError, match="scale is"):
        HomographyLocalizer(floor, scale=wrong)


def test_a_map_without_texture_and_a_grey_frame_are_refused(floor, localizer):
    with pytest.raises(MapError, match="keypoints"):
        HomographyLocalizer(MapImage(np.full((200, 200, 3), 90, np.uint8), floor.world_from_pixel))
    with pytest.raises(ImageError):
        localizer.locate(np.zeros((240, 320), np.uint8))
