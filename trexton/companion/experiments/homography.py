"""A frame's position by keypoints: match it to a map image, project its centre by a homography.

The baseline of the paper (Sec. "Dataset Generation" and "Baseline: Homography-based Approach"),
unfiltered: the fix is whatever the homography says. A tilted camera sees the floor at about height
times tilt from the point below the vehicle; the method does not know the tilt, so that offset is
part of its error, as it was in the paper.
"""

import cv2
import numpy as np

from trexton.base.errors import MapError
from trexton.base.options import number
from trexton.registration.homography import detect_keypoints, find_homography
from trexton.vision.camera import MapImage, transform_points
from trexton.vision.images import check_image

KEYPOINTS, _MAP_KEYPOINTS = 1000, 30_000  # of a frame and of the map, the strongest
_RATIO = 0.75  # a match counts if its distance is below this times that of the second nearest
_THRESHOLD = 5.0  # map pixels of reprojection up to which MAGSAC may count a match as an inlier
_KD_TREES, _CHECKS = 2, 16  # of FLANN: trees, and leaves of them that a query visits


class HomographyLocalizer:
    """Locates frames on a map image; the map's keypoints and their search index are prepared once.

    Parameters
    ----------
    map_image : MapImage
    scale : float
        Size at which frames are searched for keypoints; 0.5 takes two fifths of the time and loses
        some frames.

    Raises
    ------
    MapError
        The map image has too few keypoints.
    ParameterError
        `scale` is not above 0 and up to 1.
    """

    def __init__(self, map_image: MapImage, *, scale: float = 1.0):
        self.scale = number(scale, "scale", above=0, high=1)
        self.map_image = map_image
        mask = None if map_image.mask is None else map_image.mask.astype(np.uint8)
        luma = cv2.cvtColor(map_image.image, cv2.COLOR_BGR2GRAY)
        self._map = detect_keypoints(luma, limit=_MAP_KEYPOINTS, mask=mask)
        if len(self._map) < 4:
            raise MapError(
                f"the map image has {len(self._map)} keypoints, a homography needs 4: "
                "give a sharper or larger map"
            )
        cv2.setRNGSeed(0)  # FLANN draws its split dimensions from OpenCV's generator
        self._index = cv2.flann.Index(self._map.descriptors, {"algorithm": 1, "trees": _KD_TREES})

    def locate(self, image: np.ndarray) -> np.ndarray:
        """``(2,)`` metres: where one ``(H, W, 3) uint8`` Y, U, V frame is on the map; NaN where no
        homography was found.
        """
        homography, _ = self.match(image)
        if homography is None:
            return np.full(2, np.nan)
        rows, columns = image.shape[:2]
        center = transform_points(homography, [[(columns - 1) / 2, (rows - 1) / 2]])
        return self.map_image.to_world(center)[0]

    def match(self, image: np.ndarray) -> tuple[np.ndarray | None, np.ndarray]:
        """``(3, 3)`` homography from the frame's pixels to the map image's, or None; which of the
        matches that passed the ratio test it explains, ``(N,) bool``.
        """
        luma = cv2.extractChannel(check_image(image), 0)
        frame = detect_keypoints(luma, scale=self.scale, limit=KEYPOINTS)
        source = target = frame.points
        if len(frame):
            nearest, squared = self._index.knnSearch(
                frame.descriptors, 2, params={"checks": _CHECKS}
            )
            good = squared[:, 0] < _RATIO**2 * squared[:, 1]
            source, target = frame.points[good], self._map.points[nearest[good, 0]]
        return find_homography(source, target, _THRESHOLD)
