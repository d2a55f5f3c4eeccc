"""Do two frames show the same floor? Mutual SIFT matches within reach, under one homography."""

from __future__ import annotations

import numpy as np

from trexton.registration.homography import Keypoints, find_homography
from trexton.vision.camera import Camera, transform_points

__all__ = ["POINTS", "match_frames"]

# matched points kept for a link: enough for its homography, few enough for thousands of links
POINTS = 12
_LEAST_INLIERS = 12
_RATIO = 0.85
_THRESHOLD = 3.0  # pixels of the frame
# Inliers among the matches: few by chance within reach, but many where a floor repeats out of
# reach.
_LEAST_SHARE, _LEAST_SHARE_ANYWHERE = 0.2, 0.5


def match_frames(
    first: Keypoints,
    second: Keypoints,
    camera: Camera,
    predicted: np.ndarray | None = None,
    reach: float = np.inf,
) -> tuple[np.ndarray, np.ndarray] | None:
    """A homography and ``(2, POINTS, 2)`` matched points; None if the frames show other floors.

    `predicted` takes the first frame's pixels to the second, give or take `reach` pixels.
    """
    if min(len(first), len(second)) < _LEAST_INLIERS:
        return None
    source, target = _mutual_matches(first, second, predicted, reach)
    homography, inliers = find_homography(source, target, _THRESHOLD)
    share = _LEAST_SHARE_ANYWHERE if predicted is None else _LEAST_SHARE
    if (
        homography is None
        or inliers.sum() < max(_LEAST_INLIERS, share * len(source))
        or not _plausible(homography, camera)
    ):
        return None
    source, target = source[inliers], target[inliers]
    chosen = _spread(source, POINTS)
    return homography, np.stack([source[chosen], target[chosen]])


def _mutual_matches(
    first: Keypoints, second: Keypoints, predicted: np.ndarray | None, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Matches within reach that are nearest in both directions and pass the ratio test.

    SIFT descriptors are whole numbers up to 255: these float32 products are exact in any order.
    """
    a, b = first.descriptors, second.descriptors
    squared = (a * a).sum(axis=1)[:, None] + (b * b).sum(axis=1) - 2 * (a @ b.T)
    if predicted is not None:
        places = transform_points(predicted, first.points)
        for axis in (0, 1):
            squared[np.abs(places[:, None, axis] - second.points[:, axis]) > reach] = np.inf
    forward, backward = squared.argmin(axis=1), squared.argmin(axis=0)
    mutual = backward[forward] == np.arange(len(a))
    rows = np.flatnonzero(mutual & np.isfinite(squared.min(axis=1)))
    columns = forward[rows]
    nearest = squared[rows, columns]
    squared[rows, columns] = np.inf
    good = nearest < _RATIO**2 * squared[rows].min(axis=1, initial=np.inf)
    return first.points[rows[good]], second.points[columns[good]]


def _plausible(homography: np.ndarray, camera: Camera) -> bool:
    """True if the frame's outline stays a convex quadrangle of about its size."""
    width, height = camera.width, camera.height
    corners = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=float)
    sides = np.diff(transform_points(homography, corners)[[0, 1, 2, 3, 0]], axis=0)
    turns = sides[:, 0] * np.roll(sides[:, 1], -1) - sides[:, 1] * np.roll(sides[:, 0], -1)
    return bool((turns > 0.25 * width * height).all() and (turns < 4 * width * height).all())


def _spread(points: np.ndarray, count: int) -> np.ndarray:
    """`count` points far from one another (farthest-point sampling; of few, some repeat)."""
    chosen = [int(np.argmax(((points - points.mean(axis=0)) ** 2).sum(axis=1)))]
    distance = np.full(len(points), np.inf)
    while len(chosen) < count:
        distance = np.minimum(distance, ((points - points[chosen[-1]]) ** 2).sum(axis=1))
        chosen.append(int(np.argmax(distance)))
    return np.array(chosen)
