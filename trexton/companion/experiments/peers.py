"""Keypoint methods beside coarse to fine: the paper's SIFT, and ORB, the quick one of OpenCV.

Offers `make_peer`, which locates single frames on a map image.
"""

from __future__ import annotations

from typing import Any, Protocol

import cv2
import numpy as np

from trexton.base.errors import MapError
from trexton.registration.homography import HomographyFix, HomographyLocalizer, find_homography
from trexton.vision.camera import MapImage, transform_points
from trexton.vision.images import check_image

PEERS = ("sift", "orb")
_MAP, _FRAME = 20_000, 1_000  # most keypoints of the map and of a frame
_RATIO, _THRESHOLD = 0.8, 5.0  # of the two nearest distances; pixels of the map


class Peer(Protocol):
    """Locates single frames on a map image."""

    def locate(self, image: np.ndarray) -> HomographyFix:
        """Locate one ``(H, W, 3) uint8`` Y, U, V frame."""


class OrbLocalizer:
    """Homography from ORB keypoints, matched by brute force under the Hamming distance.

    Parameters
    ----------
    map_image : MapImage

    Raises
    ------
    MapError
        The map image has too few keypoints.
    """

    def __init__(self, map_image: MapImage):
        self.map_image = map_image
        mask = None if map_image.mask is None else map_image.mask.astype(np.uint8)
        luma = cv2.cvtColor(map_image.image, cv2.COLOR_BGR2GRAY)
        self._points, descriptors = self._describe(luma, _MAP, mask)
        if len(self._points) < 4:
            raise MapError(
                f"the map image has {len(self._points)} keypoints, a homography needs 4: "
                "give a sharper or larger map"
            )
        self._matcher = cv2.BFMatcher(cv2.NORM_HAMMING)
        self._matcher.add([descriptors])

    def _describe(
        self, luma: np.ndarray, limit: int, mask: np.ndarray | None = None
    ) -> tuple[np.ndarray, Any]:
        detector = cv2.ORB.create(nfeatures=limit)
        found, descriptors = detector.detectAndCompute(np.ascontiguousarray(luma), mask)
        return np.array([keypoint.pt for keypoint in found]).reshape(-1, 2), descriptors

    def locate(self, image: np.ndarray) -> HomographyFix:
        """Locate one ``(H, W, 3) uint8`` Y, U, V frame on the map."""
        points, descriptors = self._describe(check_image(image)[..., 0], _FRAME)
        pairs = self._matcher.knnMatch(descriptors, k=2) if len(points) else []
        good = [
            pair[0]
            for pair in pairs
            if len(pair) == 2 and pair[0].distance < _RATIO * pair[1].distance
        ]
        source = points[[match.queryIdx for match in good]]
        target = self._points[[match.trainIdx for match in good]]
        homography, inliers = find_homography(source, target, _THRESHOLD)
        if homography is None:
            return HomographyFix(np.full(2, np.nan), len(good), 0)
        rows, columns = image.shape[:2]
        center = np.array([[(columns - 1) / 2, (rows - 1) / 2]])
        place = self.map_image.to_world(transform_points(homography, center))[0]
        return HomographyFix(place, len(good), int(inliers.sum()), homography)


def make_peer(name: str, map_image: MapImage) -> Peer:
    """The method called `name`, one of `PEERS`, on a map image."""
    return HomographyLocalizer(map_image) if name == "sift" else OrbLocalizer(map_image)
