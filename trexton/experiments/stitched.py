"""What the homography experiments share: the stitched map of a flight, and where a map says its frames were."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import cv2
import numpy as np

from trexton.cache import cached
from trexton.camera import MapImage
from trexton.flights.flight import Flight
from trexton.homography import HomographyLocalizer, detect_keypoints
from trexton.mosaic import Mosaic, stitch
from trexton.progress import progress

__all__ = ["Located", "floor_residual", "locate_all", "picture_of", "stitched_map"]

# Keypoints of two pictures of one floor that are further apart than this are taken for mismatches, in metres.
_MISMATCH = 0.3


def stitched_map(train: Flight, anchors: int = 12) -> Mosaic:
    """The mosaic of `train`, from the cache if the same inputs were seen before."""

    def compute() -> dict[str, np.ndarray]:
        mosaic = stitch(train, anchors=anchors)
        rows, columns = mosaic.map.image.shape[:2]
        return {
            "image": mosaic.map.image,
            "world_from_pixel": mosaic.map.world_from_pixel,
            "mask": np.ones((rows, columns), bool) if mosaic.map.mask is None else mosaic.map.mask,
            "poses": mosaic.poses,
            "used": mosaic.used,
            "anchors": mosaic.anchors,
            "pairs": mosaic.pairs,
            "errors": mosaic.errors,
            "rejected": np.int64(mosaic.rejected),
        }

    kept = cached("mosaic", "trexton.mosaic.stitching", {"flight": train.data_hash, "anchors": anchors}, compute)
    picture = MapImage(kept["image"], kept["world_from_pixel"], kept["mask"])
    names = ("poses", "used", "anchors", "pairs", "errors")
    return Mosaic(picture, *(kept[name] for name in names), rejected=int(kept["rejected"]))


@dataclass(frozen=True, eq=False)
class Located:
    """Fixes of many frames: `position` ``(N, 2)`` metres (NaN where none was found), `inliers` ``(N,)``, `seconds` ``(N,)``."""

    position: np.ndarray
    inliers: np.ndarray
    seconds: np.ndarray

    @property
    def found(self) -> np.ndarray:
        """``(N,) bool``: frames for which a homography was found."""
        return np.isfinite(self.position).all(axis=1)


def locate_all(picture: MapImage, flight: Flight, label: str) -> Located:
    """Locate every frame of a flight on a map image, one after the other, unfiltered."""
    localizer = HomographyLocalizer(picture)
    position, inliers, seconds = [], [], []
    for image in progress(flight.images(), label, len(flight)):
        start = perf_counter()
        fix = localizer.locate(image)
        seconds.append(perf_counter() - start)
        position.append(fix.position)
        inliers.append(fix.inliers)
    return Located(np.array(position), np.array(inliers), np.array(seconds))


def floor_residual(picture: MapImage, floor: MapImage) -> tuple[np.ndarray, np.ndarray]:
    """How far a map is off: true places ``(K, 2)`` of matched keypoints, and the map's deviation ``(K, 2)``, metres."""
    found = []
    for each in (picture, floor):
        mask = None if each.mask is None else each.mask.astype(np.uint8)
        found.append(detect_keypoints(cv2.cvtColor(each.image, cv2.COLOR_BGR2GRAY), limit=20_000, mask=mask))
    cv2.setRNGSeed(0)
    index = cv2.flann_Index(found[1].descriptors, {"algorithm": 1, "trees": 4})
    nearest, squared = index.knnSearch(found[0].descriptors, 2, params={"checks": 64})
    good = squared[:, 0] < 0.75**2 * squared[:, 1]
    truth = floor.to_world(found[1].points[nearest[good, 0]])
    deviation = picture.to_world(found[0].points[good]) - truth
    near = np.hypot(*deviation.T) < _MISMATCH
    return truth[near], deviation[near]


def picture_of(picture: MapImage, width: int = 900) -> tuple[dict, np.ndarray]:
    """A map as figures draw it: its extent, for the record's series, and a picture of `width` pixels; unmapped is white."""
    image = picture.image
    if picture.mask is not None:
        image = np.where(picture.mask[..., None], image, 255).astype(np.uint8)
    rows, columns = image.shape[:2]
    (left, top), (right, bottom) = picture.to_world([(-0.5, -0.5), (columns - 0.5, rows - 0.5)])
    small = cv2.resize(image, (width, round(width * rows / columns)), interpolation=cv2.INTER_AREA)
    return {"extent_m": [left, right, bottom, top]}, small
