"""The hyperspatial image: one picture of the floor from a flight (Sec. "Dataset Generation").

The paper used a closed program for this. Here frames are linked by keypoints, all their poses are
adjusted at once over a plane, and the frames are blended; a handful of motion-capture positions
place the picture in the world.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from trexton.base.errors import FlightError, MapError
from trexton.base.options import whole
from trexton.flights.flight import Flight
from trexton.registration.adjust import adjust, link_errors
from trexton.registration.blend import blend
from trexton.registration.layout import layout
from trexton.registration.links import (
    Anchors,
    Links,
    flight_keypoints,
    spatial_links,
    successive_links,
)
from trexton.registration.sparse import connected
from trexton.vision.camera import Camera, MapImage

__all__ = ["Mosaic", "flight_camera", "map_from_links", "stitch"]

# Of a frame's width: how far off the layout may be each time spatial neighbours are looked for.
_REACHES = (0.2, 0.05)
_NEIGHBORS = 6  # most spatial neighbours that a frame is matched with, beside its successors
# Scale and most keypoints; the second where the first leaves out too many frames, as of photographs
# taken high up and far apart.
_SEARCHES: tuple[tuple[float, int], ...] = ((0.5, 600), (1.0, 2000))
_ENOUGH = 0.8  # of the frames
_FEW = 12  # anchors, where positions are as good as those of motion capture
_GRAIN = 0.55  # map pixels for each pixel of a frame: the map keeps what most keypoints need
_FOCAL = 0.8  # image widths, where the camera is not known
_TRUSTED = 3.0  # pixels: a link whose median error is larger is wrong


@dataclass(frozen=True, eq=False)
class Mosaic:
    """A stitched map and how it came about.

    Attributes
    ----------
    map : MapImage
    poses : (N, 8) array
        Pose of each frame of the flight, see `trexton.registration.poses`.
    used : (N,) bool array
        Frames in the picture; the others could not be linked.
    anchors : (A,) int array
        Rows of the frames whose recorded position placed the map in the world.
    links : Links
        Pairs of frames that see the same floor, with matched points.
    errors : (L,) array
        Median distance in frame pixels between the points of a link, after the adjustment.
    rejected : int
        Links that contradicted the others.
    """

    map: MapImage
    poses: np.ndarray
    used: np.ndarray
    anchors: np.ndarray
    links: Links
    errors: np.ndarray
    rejected: int


def stitch(flight: Flight, *, anchors: int | None = None) -> Mosaic:
    """Stitch the hyperspatial image of a flight (Sec. "Dataset Generation").

    Only images and the positions of `anchors` frames, evenly spread in time, are used: no attitude,
    no height. Where the camera is not known, a usual focal length is assumed, and the heights
    absorb most of the error.

    Parameters
    ----------
    anchors : int, optional
        Frames whose recorded position is used, at least 3. By default 12, and of a flight with an
        origin on Earth all: GPS errs by metres, a chain of aerial photographs drifts by tens.

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
        if mosaics[-1].used.mean() >= _ENOUGH:
            break
    return max(mosaics, key=lambda mosaic: int(mosaic.used.sum()))


def _stitched(flight: Flight, camera: Camera, anchors: int, scale: float, keypoints: int) -> Mosaic:
    described = flight_keypoints(flight, scale=scale, limit=keypoints)
    links = successive_links(described, camera)
    held = _choose_anchors(flight, links, anchors)
    poses = adjust(layout(len(flight), links, held, camera.focal), links, held, camera.focal)
    linked: set[tuple[int, int]] = set()
    for reach in _REACHES:
        links = links + spatial_links(described, poses, camera, _NEIGHBORS, reach, linked)
        poses = adjust(poses, links, held, camera.focal, widths=(8, 4, 2))
    return _finished(flight, poses, links, held, camera)


def map_from_links(flight: Flight, links: Links, *, anchors: int) -> Mosaic:
    """The mosaic that these links make, no others looked for; errors as for `stitch`.

    With links along the path only and few anchors it drifts, as a map does that never notices a
    place again.
    """
    camera = flight_camera(flight)
    held = _choose_anchors(flight, links, anchors)
    poses = adjust(layout(len(flight), links, held, camera.focal), links, held, camera.focal)
    return _finished(flight, poses, links, held, camera)


def _finished(
    flight: Flight, poses: np.ndarray, links: Links, held: Anchors, camera: Camera
) -> Mosaic:
    """Drop the links that contradict the others, adjust once more, blend."""
    agreeing = _median_errors(poses, links, camera) < _TRUSTED
    links, rejected = links[agreeing], int((~agreeing).sum())
    used = _placed(len(flight), links, held.rows)
    poses = adjust(poses, links, held, camera.focal, widths=(2,))
    pixels_per_metre = _GRAIN * camera.focal / float(np.median(poses[used, 2]))
    picture = blend(flight, poses, used, camera, pixels_per_metre)
    errors = _median_errors(poses, links, camera)
    return Mosaic(picture, poses, used, held.rows, links, errors, rejected)


def _median_errors(poses: np.ndarray, links: Links, camera: Camera) -> np.ndarray:
    return np.median(link_errors(poses, links, camera.focal), axis=1)


def flight_camera(flight: Flight) -> Camera:
    """The camera of a flight, or a usual one; `FlightError` if it takes other images."""
    height, width = flight.image(0).shape[:2]
    camera = flight.camera or Camera(width, height, _FOCAL * width)
    if (camera.width, camera.height) != (width, height):
        raise FlightError(
            f"the images of flight {flight.name!r} are {width}x{height}, "
            f"its camera takes {camera.width}x{camera.height}: correct [camera] in flight.toml"
        )
    return camera


def _choose_anchors(flight: Flight, links: Links, count: int) -> Anchors:
    """`count` frames evenly spread in time among those that have a position and a link."""
    count = whole(count, "anchors", 3)
    linked = np.zeros(len(flight), bool)
    linked[links.pairs.ravel()] = True
    rows = np.flatnonzero(linked & flight.located)
    if not linked.any():
        raise MapError(
            f"no two successive frames of flight {flight.name!r} could be matched: "
            "a mosaic needs overlapping frames of a floor with texture"
        )
    if len(rows) < 3:
        raise FlightError(
            f"flight {flight.name!r} has {len(rows)} linked frames with a position, a mosaic needs "
            "3: record more of them"
        )
    rows = np.unique(rows[np.linspace(0, len(rows) - 1, count).round().astype(int)])
    return Anchors(rows, flight.position[rows])


def _placed(count: int, links: Links, anchors: np.ndarray) -> np.ndarray:
    """``(N,) bool``: frames on the largest piece of linked ones, or on one with two anchors."""
    piece = connected(count, links.pairs)
    placed = np.bincount(piece[anchors], minlength=piece.max() + 1) >= 2
    placed[np.argmax(np.bincount(piece))] = True
    return placed[piece]
