"""SIFT keypoints of an image, and the homography between two images that their matches agree on."""

from dataclasses import dataclass

import cv2
import numpy as np


@dataclass(frozen=True, eq=False)
class Keypoints:
    """SIFT keypoints: `points` ``(N, 2)`` (column, row), `descriptors` ``(N, 128) float32``."""

    points: np.ndarray
    descriptors: np.ndarray

    def __len__(self) -> int:
        return len(self.points)


def detect_keypoints(
    luma: np.ndarray, *, scale: float = 1.0, limit: int = 0, mask: np.ndarray | None = None
) -> Keypoints:
    """SIFT keypoints of an ``(H, W) uint8`` image, detected at `scale`, in the pixels of the whole
    image.

    At most `limit` of them, the strongest (0: all), and only where `mask` is nonzero.
    """
    luma = np.ascontiguousarray(luma)
    if scale != 1:
        size = [max(1, round(scale * length)) for length in luma.shape[::-1]]
        ratio = np.array(luma.shape[::-1]) / size
        luma = cv2.resize(luma, size, interpolation=cv2.INTER_AREA)
        mask = None if mask is None else cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST)
    # Without the precise upscale every keypoint lies a quarter of a pixel too far right and down.
    sift = cv2.SIFT.create(nfeatures=limit, enable_precise_upscale=True)
    detected, descriptors = sift.detectAndCompute(luma, mask)
    if not detected:
        return Keypoints(np.empty((0, 2)), np.empty((0, 128), np.float32))
    # SIFT may return more than asked for where strengths are equal.
    points = np.array([keypoint.pt for keypoint in detected[: limit or None]])
    if scale != 1:
        points = (points + 0.5) * ratio - 0.5  # pixel centres have whole coordinates
    return Keypoints(points, descriptors[: limit or None])


def find_homography(
    source: np.ndarray, target: np.ndarray, threshold: float
) -> tuple[np.ndarray | None, np.ndarray]:
    """MAGSAC homography between ``(N, 2)`` matched points, and its ``(N,) bool`` inliers.

    Inliers lie within `threshold` pixels. None for fewer than four matches, or degenerate ones.
    """
    if len(source) >= 4:
        # At most 2000 iterations: a wrong set of matches would otherwise cost far more than a right
        # one.
        homography, inliers = cv2.findHomography(
            source, target, cv2.USAC_MAGSAC, threshold, maxIters=2000, confidence=0.995
        )
        if homography is not None and np.isfinite(homography).all():
            return homography, inliers.ravel() > 0
    return None, np.zeros(len(source), bool)
