"""The hyperspatial image: one picture of the floor from a flight (Sec. "Dataset Generation").

The paper used a closed program for this. Here frames are linked by keypoints, all their poses are
adjusted at once over a plane, and the frames are blended; a handful of motion-capture positions
place the picture in the world.
"""

from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np

from trexton.base.errors import FlightError, MapError
from trexton.base.options import whole
from trexton.base.progress import progress
from trexton.flights.flight import Flight
from trexton.localization.lens import flight_camera
from trexton.registration.adjust import adjust, anchor_sigma, left_out, link_errors
from trexton.registration.layout import (
    Anchors,
    Links,
    connected,
    layout,
    layout_by_positions,
    world_from_pixel,
)
from trexton.registration.links import (
    flight_keypoints,
    nearby_links,
    spatial_links,
    successive_links,
)
from trexton.registration.trust import PHOTOGRAPHS_S
from trexton.vision.camera import Camera, MapImage, transform_points
from trexton.vision.images import bgr_from_yuv
from trexton.vision.threads import ahead

# Of a frame's width: how far off the layout may be each time spatial neighbours are looked for.
_REACHES = (0.2, 0.05)
# Scale and most keypoints; the second where the first leaves out too many frames, as of photographs
# taken high up and far apart.
_SEARCHES: tuple[tuple[float, int], ...] = ((0.5, 600), (1.0, 2000))
_ENOUGH = 0.8  # of the frames
_FEW = 12  # anchors, where positions are as good as those of motion capture
_GRAIN = 0.55  # map pixels for each pixel of a frame: the map keeps what most keypoints need
_LARGEST = 100_000_000  # pixels of the picture
# Width in pixels at which photographs are linked, for scale 1: what stands up from the floor moves
# points by a share of the picture, however fine it is.
_WIDTH = 320
_TRUSTED = 3.0  # pixels: a link whose median error is larger is wrong
_USUAL = 4.0  # times the median of all links, where floors are not flat
_CONTRADICTS = 3.0  # standard deviations between two positions and the link of their frames
_GPS = 1.5  # metres: a receiver, until the links say how far it errs; at most twice as far
# From when on a map is in doubt: of frames, of links, of the height, radians.
_LINKED, _OPEN, _OFF, _TILTED = 0.5, 0.5, 0.25, 0.25


@dataclass(frozen=True, eq=False)
class Mosaic:
    """A stitched map and how it came about.

    Attributes
    ----------
    poses : (N, 8) array
        Pose of each frame of the flight, see `trexton.registration.layout`.
    used : (N,) bool array
        Frames in the picture; the others could not be linked.
    anchors : (A,) int array
        Rows of the frames whose recorded position placed the map in the world.
    left_out : (A,) array
        Metres from each of these positions to where the map puts the frame without it.
    errors : (L,) array
        Of each pair of linked frames, median pixels between matched points after the adjustment.
    rejected : int
        Links that contradicted the others: loops through them do not close.
    """

    map: MapImage
    poses: np.ndarray
    used: np.ndarray
    anchors: np.ndarray
    left_out: np.ndarray
    errors: np.ndarray
    rejected: int

    @property
    def doubt(self) -> str:
        """Why the map is not to be trusted; empty where nothing speaks against it."""
        linked, links = int(self.used.sum()), len(self.errors) + self.rejected
        height, roll, pitch = np.median(np.abs(self.poses[self.used][:, 2:5]), axis=0)
        off, tilt = np.median(self.left_out), float(np.hypot(roll, pitch))
        if linked < _LINKED * len(self.used):
            return f"only {linked} of {len(self.used)} frames could be linked: they overlap little"
        if self.rejected > _OPEN * links:
            return (
                f"{self.rejected} of {links} links contradict the others, loops through them do "
                "not close: the floor repeats itself, or much stands up from it"
            )
        if off > _OFF * height:
            return f"it puts positions left out {off:.3g} m off (median), from {height:.3g} m up"
        if tilt > _TILTED:
            return f"its frames would be tilted by {np.degrees(tilt):.0f} degrees (median)"
        return ""


def stitch(flight: Flight, *, anchors: int | None = None) -> Mosaic:
    """Stitch the hyperspatial image of a flight (Sec. "Dataset Generation").

    Only images and the positions of `anchors` frames, evenly spread in time, are used: no attitude,
    no height. Where the camera is not known, a usual focal length is assumed, and the heights
    absorb most of the error.

    Parameters
    ----------
    anchors : int, optional
        Frames whose recorded position is used, at least 3. By default 12, and of a flight with an
        origin on Earth all: GPS is metres off, a chain of aerial photographs drifts by tens.

    Raises
    ------
    FlightError
        The flight has no images, or too few of its frames have a position.
    MapError
        The frames cannot be linked.
    """
    if anchors is None:
        anchors = _FEW if flight.origin is None else len(flight)
    camera = flight_camera(flight)
    mosaics: list[Mosaic] = []
    for search in _SEARCHES:
        try:
            mosaics.append(_stitched(flight, camera, anchors, *search))
        except MapError:
            if search == _SEARCHES[-1] and not mosaics:
                raise
            continue
        if mosaics[-1].used.mean() >= _ENOUGH and not mosaics[-1].doubt:
            break
    return max(mosaics, key=lambda mosaic: (not mosaic.doubt, int(mosaic.used.sum())))


def _stitched(flight: Flight, camera: Camera, anchors: int, scale: float, keypoints: int) -> Mosaic:
    photographs, whole, unit = _are_photographs(flight, anchors), camera, 1.0
    if photographs:
        unit = min(1.0, _WIDTH / camera.width)
        center = unit * (np.array(camera.principal_point) + 0.5) - 0.5
        size = round(unit * camera.width), round(unit * camera.height)
        camera = Camera(*size, unit * camera.focal, (center[0], center[1]))
    described = [
        replace(each, points=unit * (each.points + 0.5) - 0.5)
        for each in flight_keypoints(flight, scale=unit * scale, limit=keypoints)
    ]
    if photographs:
        links, start = nearby_links(described, flight.position, camera), layout_by_positions
    else:
        links, start = successive_links(described, camera), layout
    held = _choose_anchors(flight, links, anchors)
    focal, rejected = camera.focal, 0
    poses = adjust(start(len(flight), links, held, focal), links, held, focal)
    linked: set[tuple[int, int]] = set()
    for reach in _REACHES:
        if held.sigma is not None:
            held = replace(held, sigma=min(anchor_sigma(poses, links, held, focal), 2 * _GPS))
        if photographs:  # what contradicts is looked for again, where the others say
            agreeing = _agreeing(poses, links, held, focal)
            links, rejected = links[agreeing], rejected + int((~agreeing).sum())
            linked = set(map(tuple, links.pairs.tolist()))
        links += spatial_links(described, poses, camera, reach, linked, photographs)
        poses = adjust(poses, links, held, focal, widths=(8, 4, 2))
    # Drop the links that contradict the others, adjust once more.
    agreeing = _agreeing(poses, links, held, focal)
    links, rejected = links[agreeing], rejected + int((~agreeing).sum())
    used = _placed(len(flight), links, held.rows)
    poses = adjust(poses, links, held, focal, widths=(2,))
    pixels_per_metre = _GRAIN * whole.focal / float(np.median(poses[used, 2]))
    picture = _blend(flight, poses, used, whole, pixels_per_metre)
    held = held[used[held.rows]]
    out, errors = left_out(poses, links, held, focal), link_errors(poses, links, focal) / unit
    return Mosaic(picture, poses, used, held.rows, np.hypot(*out.T), errors, rejected)


def _are_photographs(flight: Flight, anchors: int) -> bool:
    """Whether frames are far apart, and all that have a position are to be placed by it."""
    by_gps = flight.origin is not None and anchors >= flight.located.sum() > 2
    return bool(by_gps and np.median(np.diff(flight.time)) >= PHOTOGRAPHS_S)


def _agreeing(poses: np.ndarray, links: Links, anchors: Anchors, focal: float) -> np.ndarray:
    """``(L,) bool``: links that do not contradict the others. What stands up from the floor moves
    points between photographs from the air, so that there their usual error counts too.
    """
    errors = link_errors(poses, links, focal)
    agreeing = np.asarray(errors < _TRUSTED)
    if anchors.sigma is not None and agreeing.any():
        agreeing = errors < max(_TRUSTED, _USUAL * float(np.median(errors)))
        off = np.zeros((len(poses), 2))
        off[anchors.rows] = poses[anchors.rows, :2] - anchors.position
        apart = np.hypot(*(off[links.pairs[:, 1]] - off[links.pairs[:, 0]]).T)
        agreeing &= apart < _CONTRADICTS * np.sqrt(2) * anchors.sigma
    if not agreeing.any():
        raise MapError(
            f"all {len(links)} links between frames contradict one another: a mosaic needs "
            "overlapping frames of a flat floor that does not repeat itself"
        )
    return agreeing


def _choose_anchors(flight: Flight, links: Links, count: int) -> Anchors:
    """`count` frames evenly spread in time among those that have a position and a link."""
    count = whole(count, "anchors", 3)
    linked = np.bincount(links.pairs.ravel(), minlength=len(flight)) > 0
    # Photographs that are linked later must not stray from their positions either.
    rows = np.flatnonzero(flight.located & (linked | _are_photographs(flight, count)))
    if not linked.any():
        raise MapError(
            f"no two neighbouring frames of flight {flight.name!r} could be matched: "
            "a mosaic needs overlapping frames of a floor with texture"
        )
    if len(rows) < 3:
        raise FlightError(
            f"flight {flight.name!r} has {len(rows)} linked frames with a position, a mosaic needs "
            "3: record more of them"
        )
    rows = np.unique(rows[np.linspace(0, len(rows) - 1, count).round().astype(int)])
    return Anchors(rows, flight.position[rows], None if flight.origin is None else _GPS)


def _placed(count: int, links: Links, anchors: np.ndarray) -> np.ndarray:
    """``(N,) bool``: frames on the largest piece of linked ones, or on one with two anchors."""
    piece = connected(count, links.pairs)
    placed = np.bincount(piece[anchors], minlength=piece.max() + 1) >= 2
    placed[np.argmax(np.bincount(piece))] = True
    return placed[piece]


def _blend(
    flight: Flight, poses: np.ndarray, used: np.ndarray, camera: Camera, pixels_per_metre: float
) -> MapImage:
    """The map image of the `used` frames, ``(N,) bool``, each placed by its ``(8,)`` pose."""
    rows = np.flatnonzero(used)
    matrices = [world_from_pixel(poses[row], camera) for row in rows]
    width, height = camera.width - 1, camera.height - 1
    corners = [[0, 0], [width, 0], [width, height], [0, height]]
    outlines = [transform_points(matrix, corners) for matrix in matrices]
    (x_min, y_min), (x_max, y_max) = np.min(outlines, axis=(0, 1)), np.max(outlines, axis=(0, 1))
    columns = int(np.ceil((x_max - x_min) * pixels_per_metre))
    lines = int(np.ceil((y_max - y_min) * pixels_per_metre))
    if columns * lines > _LARGEST:
        raise MapError(
            f"the mosaic would have {columns} x {lines} pixels, at most {_LARGEST:.0e} are made: "
            "give fewer frames or more anchors"
        )
    empty = MapImage.from_extent(
        np.zeros((lines, columns, 3), np.uint8), x_min, y_max, pixels_per_metre
    )
    map_from_world = np.linalg.inv(empty.world_from_pixel)
    # 1 in the middle, falling steeply to 0 at the border
    sideways = 1 - np.abs(np.linspace(-1, 1, camera.width))
    downwards = 1 - np.abs(np.linspace(-1, 1, camera.height))
    feather = (np.outer(downwards, sideways) ** 2).astype(np.float32)

    def place(
        job: tuple[Any, np.ndarray, np.ndarray],
    ) -> tuple[tuple[slice, slice], np.ndarray, np.ndarray]:
        row, matrix, outline = job
        around = transform_points(map_from_world, outline)
        low = np.maximum(np.floor(around.min(axis=0)).astype(int), 0)
        high = np.minimum(np.ceil(around.max(axis=0)).astype(int) + 1, (columns, lines))
        size = (high - low).tolist()
        shift = np.array([[1, 0, -low[0]], [0, 1, -low[1]], [0, 0, 1]])
        local, image = shift @ map_from_world @ matrix, flight.image(row)
        edges = cv2.Laplacian(image[..., 0], cv2.CV_16S, ksize=1)  # small where motion blurs
        sharp = feather * np.float32(np.square(edges, dtype=np.float32).mean() + 1e-3)
        weight = cv2.warpPerspective(sharp, local, size, flags=cv2.INTER_LINEAR)
        seen = cv2.warpPerspective(image, local, size, flags=cv2.INTER_LINEAR)
        return (slice(low[1], high[1]), slice(low[0], high[0])), seen, weight

    total = np.zeros((lines, columns, 3), np.float32)
    weights = np.zeros((lines, columns), np.float32)
    placed = ahead(place, zip(rows, matrices, outlines, strict=True))
    for window, image, weight in progress(placed, "blending", len(rows)):
        total[window] += image * weight[..., None]
        weights[window] += weight
    mask = weights > 0
    total[mask] /= weights[mask, None]
    picture = bgr_from_yuv(np.clip(np.rint(total), 0, 255).astype(np.uint8))
    picture[~mask] = 0
    return MapImage(picture, empty.world_from_pixel, mask)
