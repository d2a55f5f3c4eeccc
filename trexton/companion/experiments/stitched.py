"""What the homography experiments share: the stitched map of a flight, and where a map puts its
frames.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from time import perf_counter
from typing import Any

import cv2
import numpy as np
from scipy.spatial import cKDTree

from trexton.base.cache import cached
from trexton.base.errors import MapError
from trexton.base.progress import progress
from trexton.flights.flight import Flight
from trexton.registration.homography import HomographyLocalizer, detect_keypoints
from trexton.registration.links import Links
from trexton.registration.mosaic import Mosaic, map_from_links, stitch
from trexton.vision.camera import MapImage

_PLAIN = ("poses", "used", "anchors", "errors")  # arrays of a mosaic that are stored as they are
SAME_PASS_FRAMES = 12  # frames: links between frames that are further apart notice a place again
FEWEST_ANCHORS = 3
# Matches of two pictures of a floor that deviate so much otherwise than so many around them are
# mismatches.
_MISMATCH, _AROUND = 0.1, 15  # metres, matches


def stitched_map(train: Flight, anchors: int = 0) -> Mosaic:
    """The mosaic of `train`, from the cache if the same inputs were seen before; of 0 `anchors` as
    many as it needs.
    """
    inputs = {"flight": train.data_hash, "anchors": anchors}
    return _kept("mosaic", inputs, lambda: stitch(train, anchors=anchors or None))


def drifting_map(train: Flight, anchors: int = 0) -> Mosaic:
    """The mosaic of `train` if it never noticed a place again: links along the path only, three
    anchors.
    """
    inputs = {
        "flight": train.data_hash,
        "anchors": anchors,
        "apart": SAME_PASS_FRAMES,
        "placed": FEWEST_ANCHORS,
    }

    def compute() -> Mosaic:
        links = stitched_map(train, anchors).links
        along = np.diff(links.pairs, axis=1).ravel() <= SAME_PASS_FRAMES
        return map_from_links(train, links[along], anchors=FEWEST_ANCHORS)

    return _kept("drifting-mosaic", inputs, compute)


def homography_maps(train: Flight, anchors: int = 0) -> dict[str, MapImage]:
    """The maps of `train` that frames are located on: ``mosaic``, and ``drifting`` where it can be
    made.
    """
    maps = {"mosaic": stitched_map(train, anchors).map}
    try:
        maps["drifting"] = drifting_map(train, anchors).map
    except MapError:
        pass  # some flights hang together only by places that are seen again
    return maps


def _kept(kind: str, inputs: dict[str, Any], compute: Callable[[], Mosaic]) -> Mosaic:
    def arrays() -> dict[str, np.ndarray]:
        mosaic = compute()
        return {
            "image": mosaic.map.image,
            "world_from_pixel": mosaic.map.world_from_pixel,
            "mask": mosaic.map.mask,
            "pairs": mosaic.links.pairs,
            "points": mosaic.links.points,
            "rejected": np.int64(mosaic.rejected),
            **{name: getattr(mosaic, name) for name in _PLAIN},
        }

    kept = cached(kind, "trexton.registration.mosaic", inputs, arrays)
    return Mosaic(
        map=MapImage(kept["image"], kept["world_from_pixel"], kept["mask"]),
        links=Links(kept["pairs"], kept["points"]),
        rejected=int(kept["rejected"]),
        **{name: kept[name] for name in _PLAIN},
    )


@dataclass(frozen=True, eq=False)
class Located:
    """Fixes of many frames: `position` ``(N, 2)`` in metres (NaN: none found), `inliers`, `seconds`
    ``(N,)``.
    """

    position: np.ndarray
    inliers: np.ndarray
    seconds: np.ndarray

    @property
    def found(self) -> np.ndarray:
        """``(N,) bool``: frames for which a homography was found."""
        return np.isfinite(self.position).all(axis=1)


def locate_all(
    pictures: dict[str, MapImage], flight: Flight, scale: float = 1.0
) -> dict[str, Located]:
    """Locate every frame of a flight on each of some maps, unfiltered; keypoints, at `scale`, are
    found once.
    """
    localizers = {
        name: HomographyLocalizer(picture, scale=scale) for name, picture in pictures.items()
    }
    describe = next(iter(localizers.values())).describe
    rows: dict[str, Any] = {name: [] for name in localizers}
    for image in progress(flight.images(), "locating", len(flight)):
        start = perf_counter()
        keypoints = describe(image)
        described_s = perf_counter() - start
        for name, localizer in localizers.items():
            start = perf_counter()
            fix = localizer.fix(keypoints, image.shape[:2])
            rows[name].append((fix.position, fix.inliers, described_s + perf_counter() - start))
    return {
        name: Located(*(np.array(column) for column in zip(*found, strict=False)))
        for name, found in rows.items()
    }


def floor_residual(picture: MapImage, floor: MapImage) -> tuple[np.ndarray, np.ndarray]:
    """How far a map is off, at keypoints that it shares with a picture of the true floor.

    A match that deviates otherwise than those around it is a mismatch and left out.

    Returns
    -------
    truth, deviation : (K, 2) arrays
        True places, and how far from them the map shows them, in metres.
    """
    found = []
    for each in (picture, floor):
        mask = None if each.mask is None else each.mask.astype(np.uint8)
        found.append(
            detect_keypoints(cv2.cvtColor(each.image, cv2.COLOR_BGR2GRAY), limit=20_000, mask=mask)
        )
    cv2.setRNGSeed(0)
    index = cv2.flann.Index(found[1].descriptors, {"algorithm": 1, "trees": 4})
    nearest, squared = index.knnSearch(found[0].descriptors, 2, params={"checks": 64})
    good = squared[:, 0] < 0.75**2 * squared[:, 1]
    truth = floor.to_world(found[1].points[nearest[good, 0]])
    deviation = picture.to_world(found[0].points[good]) - truth
    around = cKDTree(truth).query(truth, k=min(_AROUND, len(truth)))[1].reshape(len(truth), -1)
    usual = np.median(deviation[around], axis=1)
    alike = np.hypot(*(deviation - usual).T) < _MISMATCH
    return truth[alike], deviation[alike]


def picture_of(picture: MapImage, width: int = 900) -> tuple[dict[str, Any], np.ndarray]:
    """A map as figures draw it: its extent, and a picture of `width` pixels; what is not mapped is
    white.
    """
    image = picture.image
    if picture.mask is not None:
        image = np.where(picture.mask[..., None], image, 255).astype(np.uint8)
    rows, columns = image.shape[:2]
    (left, top), (right, bottom) = picture.to_world(
        np.array([(-0.5, -0.5), (columns - 0.5, rows - 0.5)])
    )
    small = cv2.resize(image, (width, round(width * rows / columns)), interpolation=cv2.INTER_AREA)
    return {"extent_m": [left, right, bottom, top]}, small
