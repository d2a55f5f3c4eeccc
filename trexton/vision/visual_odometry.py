"""How far the camera moved from one frame to the next: phase correlation of shrunken frames.

Needs no map. The shift between two frames is found for the whole image at once (Kuglin and Hines,
"The phase correlation image alignment method", 1975), so that only turning between frames and a
floor without texture disturb it; light does not.
"""

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from trexton.vision.camera import Camera, transform_points

FEWEST = 12  # points that must be followed from frame to frame, and agree
AGREED = 0.8  # share of them, above which no other motion is tried
STILL = np.eye(2, 3)


def shrink(image: np.ndarray, factor: int) -> np.ndarray:
    """Average blocks of `factor` by `factor` pixels; what fills no block is dropped."""
    if factor == 1:
        return image
    rows, columns = (max(1, length // factor) for length in image.shape[:2])
    whole = image[: rows * factor, : columns * factor]
    return cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA)


def shrunken_camera(camera: Camera, factor: int) -> Camera:
    """The camera that takes a frame of `camera` after `shrink` by `factor`."""
    x, y = camera.principal_point
    center = ((x + 0.5) / factor - 0.5, (y + 0.5) / factor - 0.5)
    return Camera(camera.width // factor, camera.height // factor, camera.focal / factor, center)


def followed(
    before: np.ndarray, after: np.ndarray, most: int, expected: np.ndarray | None = None
) -> tuple[np.ndarray, float] | None:
    """``(2, 3)`` turn, scale and shift that take the pixels of a luma frame to the next, by at most
    so many points that are followed, and the share that agrees of those still in sight; None where
    they are too few.

    They are sought where an `expected` motion takes them, which tells repeated patterns apart; if
    few agree, also where they were.
    """
    points = cv2.goodFeaturesToTrack(before, most, 0.01, 5)
    if before.shape != after.shape or points is None:
        return None
    best = None
    for start in [STILL] if expected is None else [expected, STILL]:
        motion = _followed(before, after, points, start)
        if motion is not None and (best is None or motion[1] > best[1]):
            best = motion
        if best is not None and best[1] > AGREED:
            break
    return best


def _followed(
    before: np.ndarray, after: np.ndarray, points: np.ndarray, start: np.ndarray
) -> tuple[np.ndarray, float] | None:
    moved, status, _ = cv2.calcOpticalFlowPyrLK(
        before, after, points, cv2.transform(points, start), flags=cv2.OPTFLOW_USE_INITIAL_FLOW
    )
    kept = status.ravel() > 0
    if kept.sum() < FEWEST:
        return None
    matrix, inliers = cv2.estimateAffinePartial2D(
        points[kept], moved[kept], ransacReprojThreshold=1.0
    )
    if matrix is None or inliers.sum() < FEWEST:
        return None
    now = cv2.transform(points, matrix)[:, 0]
    in_sight = ((now >= 0) & (now < before.shape[::-1])).all(axis=1).sum()
    return matrix, float(min(1.0, inliers.sum() / max(in_sight, 1)))


class VisualOdometry:
    """Motion over the floor, frame by frame.

    Parameters
    ----------
    camera : Camera
        Of the frames as they come.
    width : int
        Pixels that a shrunken frame is wide, about; smaller frames stay as they are.
    """

    def __init__(self, camera: Camera, width: int):
        self.factor = max(1, round(camera.width / width))
        self.camera = shrunken_camera(camera, self.factor)
        size = (self.camera.width, self.camera.height)
        self._taper = cv2.createHanningWindow(size, cv2.CV_32F)
        self.reset()

    def reset(self) -> None:
        """Forget the frame before."""
        self._before: NDArray[np.float32] | None = None
        self._pose: tuple[float, NDArray[np.float64]] | None = None

    def shrunken(self, image: np.ndarray) -> np.ndarray:
        """``(h, w) uint8`` luma of an ``(H, W, 3)`` Y, U, V or ``(H, W)`` luma frame."""
        return shrink(image if image.ndim == 2 else cv2.extractChannel(image, 0), self.factor)

    def shift(self, frame: np.ndarray) -> tuple[NDArray[np.float64], float]:
        """Shrunken pixels (right, up) that the view moved by since the frame before; the certainty.

        The first frame moved by nothing, with a certainty of 0.
        """
        before, self._before = self._before, frame.astype(np.float32)
        if before is None:
            return np.zeros(2), 0.0
        # OpenCV multiplies what it is given by the window, in place.
        (right, down), response = cv2.phaseCorrelate(before, frame.astype(np.float32), self._taper)
        return np.array([-right, down]), float(response)

    def step(
        self, image: np.ndarray, time: float, *, height: float, attitude: ArrayLike
    ) -> tuple[NDArray[np.float64], float] | None:
        """``(2,)`` metres a second since the frame before, along the world's axes (the vehicle's,
        without a heading), and how sure, 0 to 1; None for the first.

        Below about 0.1 two frames have nothing in common.

        Parameters
        ----------
        image : (H, W, 3) or (H, W) uint8 array
        time : float
            Stamp in seconds, later than that of the frame before.
        height : float
            Metres above the floor.
        attitude : (3,) array
            Roll, pitch, yaw in radians; of a tilt that is not known, changes look like motion.
        """
        last, now = self._pose, np.asarray(attitude, dtype=float)
        shift, sure = self.shift(self.shrunken(image))
        self._pose = (time, now)
        if last is None:
            return None
        sine, cosine = np.sin(now[2]), np.cos(now[2])
        right, up = shift * height / self.camera.focal
        seen = np.array([cosine * right - sine * up, sine * right + cosine * up])
        turned = self._aim(height, now) - self._aim(height, np.array([*last[1][:2], now[2]]))
        return (seen - turned) / (time - last[0]), sure

    def _aim(self, height: float, attitude: NDArray[np.float64]) -> NDArray[np.float64]:
        """From the point below the camera to the floor point in the middle of the image."""
        world = self.camera.world_from_pixel(np.array([0.0, 0.0, height]), attitude)
        return transform_points(world, np.array([self.camera.principal_point]))[0]
