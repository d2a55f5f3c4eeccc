"""Which frames see the same floor: successive ones, then those that a layout puts over one place.

A keypoint is looked for only near where it should be. A tiled floor looks the same every few
decimetres, and a match that is good but one tile off is the one error that no robust loss can undo.
"""

from collections.abc import Callable
from functools import partial

import numpy as np
from scipy.ndimage import binary_dilation
from scipy.spatial import cKDTree

from trexton.base.progress import progress
from trexton.flights.flight import Flight
from trexton.registration.homography import Keypoints, detect_keypoints, find_homography
from trexton.registration.layout import Links, world_from_pixel
from trexton.vision.camera import Camera, transform_points
from trexton.vision.threads import ahead

Matched = tuple[np.ndarray, np.ndarray]  # a homography and the points that agree with it
Linked = tuple[tuple[int, int], np.ndarray, np.ndarray]  # the same with its pair of frames

_NEIGHBORS = 6  # most spatial neighbours that a frame is matched with, beside its successors
_LEAST_OVERLAP = 0.08  # of a frame's area
_NEAREST = 9  # photographs that one is matched with by position, itself among them
_APART = 0.2  # of a frame's width along the path: nearer spatial neighbours say the same
_STEPS = (2, 5, 12)  # between frames of the same pass that are linked beside successive ones
# Of a frame's width: how far a keypoint may be from where it should be if nothing moved, if the
# motion is steady over some frames before and after, and if a chain of links predicts it.
_STILL, _STEADY, _CHAINED = 0.12, 0.06, 0.06
_WINDOW = 8
# matched points kept for a link: enough for its homography, few enough for thousands of links
_POINTS = 12
_LEAST_INLIERS = 12
_RATIO = 0.85
_THRESHOLD = 3.0  # pixels of the frame
# Of the matches, inliers: few by chance within reach, but many where a floor repeats out of it.
_LEAST_SHARE, _LEAST_SHARE_ANYWHERE = 0.2, 0.5


def flight_keypoints(flight: Flight, *, scale: float, limit: int) -> list[Keypoints]:
    """Keypoints of every frame."""

    def detect(row: int) -> Keypoints:
        return detect_keypoints(flight.image(row)[..., 0], scale=scale, limit=limit)

    return list(progress(ahead(detect, range(len(flight))), "keypoints", len(flight)))


def successive_links(keypoints: list[Keypoints], camera: Camera) -> Links:
    """Links of frames one, two, five and twelve apart."""
    # Most frames hardly move; one that does is looked for anywhere.
    still = (np.eye(3), _STILL * camera.width)

    def follow(pair: tuple[int, int]) -> Matched | None:
        return match_frames(keypoints, camera, pair, *still) or match_frames(
            keypoints, camera, pair
        )

    links = _all_links(follow, [(row, row + 1) for row in range(len(keypoints) - 1)], "linking")
    links = _steadied(links, keypoints, camera)
    chain = {first: homography for (first, _), homography, _ in links}

    def leap(pair: tuple[int, int]) -> Matched | None:
        predicted = np.eye(3)
        for row in range(*pair):
            if row not in chain:
                return match_frames(keypoints, camera, pair)
            predicted = chain[row] @ predicted
        return match_frames(keypoints, camera, pair, predicted, _CHAINED * camera.width)

    pairs = [(row, row + step) for step in _STEPS for row in range(len(keypoints) - step)]
    return _as_links(links + _all_links(leap, pairs, "linking"), camera)


def _steadied(links: list[Linked], keypoints: list[Keypoints], camera: Camera) -> list[Linked]:
    """The links; those that jump looked for again where the motion before and after says."""
    center = np.array([camera.principal_point])
    moved = [transform_points(homography, center)[0] for _, homography, _ in links]
    shift = np.array(moved).reshape(-1, 2) - center
    result = []
    for place, link in enumerate(links):
        usual = np.median(shift[max(0, place - _WINDOW) : place + _WINDOW + 1], axis=0)
        if np.abs(shift[place] - usual).max() > _STEADY * camera.width:
            predicted = np.array([[1, 0, usual[0]], [0, 1, usual[1]], [0, 0, 1]])
            again = match_frames(keypoints, camera, link[0], predicted, _STEADY * camera.width)
            link = (link[0], *again) if again else link
        result.append(link)
    return result


def spatial_links(
    keypoints: list[Keypoints],
    poses: np.ndarray,
    camera: Camera,
    reach: float,
    linked: set[tuple[int, int]],
    photographs: bool,
) -> Links:
    """Links of frames that their ``(N, 8)`` `poses` put over the same floor on different passes.

    Parameters
    ----------
    reach : float
        Of a frame's width: how far a keypoint may be from where the poses put it.
    linked : set of pairs
        Left out; the pairs found are added to it.
    photographs : bool
        They are matched along the path too, where about a frame's heading is known: it or its
        neighbour has been linked.
    """
    matrices = [world_from_pixel(pose, camera) for pose in poses]

    def revisit(pair: tuple[int, int]) -> Matched | None:
        first, second = pair
        predicted = np.linalg.solve(matrices[second], matrices[first])
        return match_frames(keypoints, camera, pair, predicted, reach * camera.width)

    known = np.ones(len(poses), bool)
    if photographs:
        ends = np.array(sorted(linked)).ravel()
        known = binary_dilation(np.bincount(ends, minlength=len(poses)) > 0)
    pairs = _spatial_pairs(poses, camera, known, 0.0 if photographs else 1.0)
    links = _all_links(revisit, sorted(pairs - linked), "linking passes")
    linked.update(pair for pair, _, _ in links)
    return _as_links(links, camera)


def nearby_links(keypoints: list[Keypoints], position: np.ndarray, camera: Camera) -> Links:
    """Links of photographs and those taken nearest to them by ``(N, 2)`` positions that err."""
    rows = np.flatnonzero(np.isfinite(position).all(axis=1))
    nearest = rows[cKDTree(position[rows]).query(position[rows], min(_NEAREST, len(rows)))[1]]
    both = np.sort(np.stack([np.broadcast_to(rows[:, None], nearest.shape), nearest], axis=-1))
    pairs = {(first, second) for first, second in both.reshape(-1, 2).tolist() if first < second}
    match = partial(match_frames, keypoints, camera)
    return _as_links(_all_links(match, sorted(pairs), "linking"), camera)


def _spatial_pairs(
    poses: np.ndarray, camera: Camera, known: np.ndarray, apart: float
) -> set[tuple[int, int]]:
    """For each `known` frame, ``(N,) bool``, up to `_NEIGHBORS` others, by overlap, spread along
    the path and over `apart` footprints along it from the frame.
    """
    seen = float(np.median(poses[:, 2])) / camera.focal * np.array([camera.width, camera.height])
    path = np.concatenate([[0], np.cumsum(np.hypot(*np.diff(poses[:, :2], axis=0).T))])
    cos, sin = np.cos(poses[:, 5]), np.sin(poses[:, 5])
    pairs = set()
    for row in range(len(poses)):
        x, y = (poses[:, :2] - poses[row, :2]).T
        right, up = cos[row] * x + sin[row] * y, cos[row] * y - sin[row] * x
        overlap = np.maximum(1 - np.abs(right) / seen[0], 0)
        overlap *= np.maximum(1 - np.abs(up) / seen[1], 0)
        overlap[np.abs(path - path[row]) < apart * seen.max()] = 0
        overlap[row] = 0
        overlap *= known & known[row]
        taken: list[int] = []
        for other in np.argsort(-overlap, kind="stable"):
            if overlap[other] < _LEAST_OVERLAP or len(taken) == _NEIGHBORS:
                break
            if not taken or np.abs(path[taken] - path[other]).min() > _APART * seen.max():
                taken.append(int(other))
                pairs.add((min(row, int(other)), max(row, int(other))))
    return pairs


def _all_links(
    match: Callable[[tuple[int, int]], Matched | None], pairs: list[tuple[int, int]], label: str
) -> list[Linked]:
    """``(pair, homography, points)`` of every pair that `match` finds, in order."""
    from threadpoolctl import threadpool_limits

    # Every core is busy; more threads inside the products would only wait for one another.
    with threadpool_limits(1, "blas"):
        matched = progress(ahead(match, pairs), label, len(pairs))
        return [(pair, *links) for pair, links in zip(pairs, matched, strict=False) if links]


def _as_links(links: list[Linked], camera: Camera) -> Links:
    pairs = np.array([pair for pair, _, _ in links], dtype=np.int64).reshape(-1, 2)
    points = np.array([points for _, _, points in links]).reshape(-1, 2, _POINTS, 2)
    return Links(pairs, points - np.array(camera.principal_point))


def match_frames(
    keypoints: list[Keypoints],
    camera: Camera,
    pair: tuple[int, int],
    predicted: np.ndarray | None = None,
    reach: float = np.inf,
) -> Matched | None:
    """A homography and ``(2, _POINTS, 2)`` matched points; None if the frames show other floors.

    `predicted` takes the first frame's pixels to the second, give or take `reach` pixels.
    """
    first, second = keypoints[pair[0]], keypoints[pair[1]]
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
    chosen = _spread(source, _POINTS)
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
