"""The camera's pose to a fraction of a pixel, by optical flow against an expected view. Offers
`Aligner`, which solves for it by least squares."""

from dataclasses import dataclass, replace

import cv2
import numpy as np

from trexton.registration.ground import Ground
from trexton.vision.camera import Camera, rotation_matrix, transform_points

_SPACING = 8  # pixels between points
_WINDOW, _LEVELS, _STOP = (11, 11), 1, (3, 10, 0.02)  # of the optical flow (Lucas and Kanade)
_FAR = 2.0  # pixels of flow from which the expected view is made anew
_LOCAL = (15, 15)  # pixels over which contrast is normalised: light and vignetting change slower
_HUBER = 1.5  # standard deviations from which a point counts less
_STRAIGHT = 0.01  # rad: after a smaller change of tilt the equations are as good as linear
_FEWEST = 8  # points
_MEDIAN = 1.1774  # of the length of a plane vector with unit standard deviations


@dataclass(frozen=True, eq=False)
class Alignment:
    """A pose ``(6,)``, x, y, z in metres and roll, pitch, yaw in radians, and what speaks for it.

    The ``(6, 6)`` covariance is of the curvature at the solution, points taken as independent. The
    `score` is the correlation of the frame with the view expected there, 0 for too few points; the
    `flow` the median length in pixels of how far the start was off.
    """

    pose: np.ndarray
    covariance: np.ndarray
    score: float
    flow: float


@dataclass(frozen=True, eq=False)
class Candidate:
    """A place in cells (column, row), the belief in it, and the frame aligned there."""

    place: np.ndarray
    held: float
    aligned: Alignment


class Aligner:
    """Aligns shrunken frames, as `camera` takes them, with a floor about as fine as they are."""

    def __init__(self, ground: Ground, camera: Camera):
        self.ground, self.camera = ground, camera
        self._luma = np.clip(np.rint(ground.luma), 0, 255).astype(np.uint8)
        self._mask = (255 * ground.mask).astype(np.uint8)
        x = np.arange(_SPACING // 2 + 1, camera.width - _SPACING // 2, _SPACING)
        y = np.arange(_SPACING // 2 + 1, camera.height - _SPACING // 2, _SPACING)
        self._points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2).astype(np.float32)
        center = np.array(camera.principal_point)
        rays = (self._points - center) / camera.focal
        self._rays = np.column_stack([rays[:, 0], -rays[:, 1], -np.ones(len(rays))])

    def view(self, world_from_pixel: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What the camera sees from there, ``(h, w) uint8``, and a mask of what of it is mapped."""
        matrix = self.ground.from_world @ world_from_pixel
        size, inverse = (self.camera.width, self.camera.height), cv2.WARP_INVERSE_MAP
        picture = cv2.warpPerspective(self._luma, matrix, size, flags=cv2.INTER_LINEAR | inverse)
        mask = cv2.warpPerspective(self._mask, matrix, size, flags=cv2.INTER_NEAREST | inverse)
        return picture, mask

    def align(self, frame: np.ndarray, start: np.ndarray, deviation: np.ndarray) -> Alignment:
        """Align a frame from a start that is off by no more than about a tenth of its width.

        Parameters
        ----------
        frame : (h, w) uint8 array
        start, deviation : (6,) arrays
            The pose expected, at which the view is made, and its standard deviations (inf: any).
        """
        seen = flattened(frame)
        aligned = self._once(seen, start, start, deviation)
        for _ in range(2):
            if not _FAR < aligned.flow < np.inf:
                break
            aligned = self._once(seen, aligned.pose, start, deviation)
        if aligned.flow < np.inf:
            picture, mask = self.view(self._world(aligned.pose))
            aligned = replace(aligned, score=_score(seen, flattened(picture, mask), mask))
        return aligned

    def center(self, pose: np.ndarray) -> np.ndarray:
        """``(2,)`` metres: the floor point that the image centre shows."""
        return np.asarray(transform_points(self._world(pose), [self.camera.principal_point])[0])

    def _world(self, pose: np.ndarray) -> np.ndarray:
        return self.camera.world_from_pixel(pose[:3], pose[3:])

    def _once(
        self, seen: np.ndarray, start: np.ndarray, expected: np.ndarray, deviation: np.ndarray
    ) -> Alignment:
        """One view, one flow, one solution."""
        world = self._world(start)
        picture, mask = self.view(world)
        view = flattened(picture, mask)
        moved, status, _ = cv2.calcOpticalFlowPyrLK(
            seen, view, self._points, self._points.copy(),
            winSize=_WINDOW, maxLevel=_LEVELS, criteria=_STOP,
        )  # fmt: skip
        moved = np.asarray(moved, np.float32)
        inside = np.clip(np.rint(moved).astype(int), 0, np.array(mask.shape[::-1]) - 1)
        good = (np.asarray(status).ravel() > 0) & (mask[inside[:, 1], inside[:, 0]] > 0)
        columns, rows = self._points.astype(int).T
        good &= mask[rows, columns] > 0
        if good.sum() < _FEWEST:
            return Alignment(start, np.full((6, 6), np.inf), 0.0, np.inf)
        floor = transform_points(world, moved[good])
        flow = _middle(np.hypot(*(moved - self._points)[good].T))
        pose, covariance = self._solve(self._rays[good], floor, start, expected, deviation)
        return Alignment(pose, covariance, 0.0, flow)

    def _solve(
        self,
        rays: np.ndarray,
        floor: np.ndarray,
        pose: np.ndarray,
        expected: np.ndarray,
        deviation: np.ndarray,
    ) -> tuple[np.ndarray, np.ndarray]:
        """The pose whose `rays` meet the floor at `floor`, and its covariance.

        Gauss-Newton over what is expected of the pose, points weighed by Huber's function.
        """
        information = np.diag(1 / np.square(deviation))
        for _ in range(2):
            residual, jacobian = _linearised(pose, rays, floor)
            jacobian = jacobian.reshape(-1, 6)
            change, left = np.zeros(6), residual
            for _ in range(2):
                length = np.sqrt(left[:, 0] ** 2 + left[:, 1] ** 2)
                noise = max(_middle(length) / _MEDIAN, 1e-4 * pose[2])
                weight = np.minimum(1, _HUBER * noise / np.maximum(length, 1e-9))
                weight[length > 6 * noise] = 0
                weighted = jacobian * np.repeat(weight / noise**2, 2)[:, None]
                hessian = weighted.T @ jacobian + information
                gradient = weighted.T @ residual.ravel() + information @ (expected - pose)
                change = np.linalg.solve(hessian, gradient)
                left = residual - (jacobian @ change).reshape(-1, 2)
            pose = pose + change
            if np.abs(change[3:5]).max() < _STRAIGHT:
                break
        return pose, np.linalg.inv(hessian)


def _middle(values: np.ndarray) -> float:
    """The median, quickly."""
    return float(np.partition(values, len(values) // 2)[len(values) // 2])


def _linearised(
    pose: np.ndarray, rays: np.ndarray, floor: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Where rays should meet the floor minus where they do, ``(N, 2)``; the latter's Jacobian."""
    turned = rays @ rotation_matrix(*pose[3:]).T
    x, y, z = turned.T
    height = pose[2]
    residual = floor - pose[:2] + height * turned[:, :2] / z[:, None]
    jacobian = np.zeros((len(rays), 2, 6))
    jacobian[:, 0, 0] = jacobian[:, 1, 1] = 1
    jacobian[:, :, 2] = -turned[:, :2] / z[:, None]
    sine, cosine = np.sin(pose[5]), np.cos(pose[5])
    # Axes of roll, pitch and yaw; tilt is small, so that roll turns about the forward axis.
    for column, (a, b, c) in enumerate(((-sine, cosine, 0), (cosine, sine, 0), (0, 0, 1)), 3):
        dx, dy, dz = b * z - c * y, c * x - a * z, a * y - b * x
        jacobian[:, 0, column] = -height * (dx - x * dz / z) / z
        jacobian[:, 1, column] = -height * (dy - y * dz / z) / z
    return residual, jacobian


def flattened(image: np.ndarray, mask: np.ndarray | None = None) -> np.ndarray:
    """The image with equal contrast everywhere, ``uint8``: gain and vignetting move no flow."""
    values = image.astype(np.float32)
    mean = cv2.blur(values, _LOCAL)
    spread = np.sqrt(np.maximum(cv2.blur(values * values, _LOCAL) - mean * mean, 0)) + 4
    contrast = cv2.divide(values - mean, spread)
    level = cv2.convertScaleAbs(cv2.addWeighted(contrast, 42, mean, 0, 128))
    return level if mask is None else np.where(mask > 0, level, 128).astype(np.uint8)


def _score(seen: np.ndarray, view: np.ndarray, mask: np.ndarray) -> float:
    """Correlation of two flattened images where the mask is nonzero."""
    if cv2.countNonZero(mask) < 0.1 * mask.size:
        return 0.0
    (a, sa), (b, sb) = (cv2.meanStdDev(each, mask=mask) for each in (seen, view))
    product = cv2.mean(cv2.multiply(seen, view, dtype=cv2.CV_32F), mask=mask)[0]
    return float((product - a * b).item() / max((sa * sb).item(), 1e-6))
