"""Frame after frame on the floor: coarse correlation says where about, alignment where exactly."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from trexton.camera import Camera, MapImage, transform_points
from trexton.errors import ParameterError
from trexton.odometry import VisualOdometry
from trexton.registration.alignment import Aligner, Alignment
from trexton.registration.belief import CellBelief
from trexton.registration.correlation import CoarseMatcher
from trexton.registration.ground import Ground

__all__ = ["FloorFix", "FloorTracker", "Trust"]

_FRAME = 80  # pixels that a shrunken frame is wide
_COARSE = 24  # cells that a frame's footprint is wide
_HEADINGS = 36
_MARGIN = 3  # cells searched around what is believed
_SURE = 0.15  # certainty of the odometry from which it is believed
_MODE = 5  # cells around a peak that count as one place
_TILT, _HEIGHT = (
    0.07,
    0.1,
)  # rad, share: what is known of an unmeasured tilt, of an unmeasured height
_BETWEEN = np.array(
    [0.03, 0.03]
)  # share of the height, rad: height and heading from frame to frame


@dataclass(frozen=True)
class Trust:
    """How much a frame's fit says; learnt from a flight with `trexton.registration.calibration.calibrate`.

    Attributes
    ----------
    coarse, fine : float
        Independent pixels that a correlation of the coarse and of the fine images is worth.
    least : float
        Fine correlation below which a frame is not where it seems to be.
    scale, floor : float
        Variances are the alignment's times `scale` plus `floor` square metres.
    """

    coarse: float = 20.0
    fine: float = 20.0
    least: float = 0.4
    scale: float = 4.0
    floor: float = 4e-6


@dataclass(frozen=True, eq=False)
class FloorFix:
    """What one frame gives.

    Attributes
    ----------
    pose : (6,) array
        x, y, z in metres, roll, pitch, yaw in radians.
    covariance : (2, 2) array
        Of x and y.
    score : float
        Correlation of the frame with the floor at this pose.
    held : float
        Share of the belief at this place.
    lost : bool
        The pose must not be trusted.
    observed : bool
        False where no frame came.
    """

    pose: np.ndarray
    covariance: np.ndarray
    score: float
    held: float
    lost: bool
    observed: bool

    @property
    def position(self) -> np.ndarray:
        """``(2,)`` x, y in metres."""
        return self.pose[:2]


class FloorTracker:
    """Locates successive frames on a picture of the floor.

    Parameters
    ----------
    picture : MapImage
    camera : Camera
    height : float
        Usual height of the camera in metres; cells and resolutions follow from it.
    trust : Trust
    attitude_sigma, height_sigma : float
        Standard deviations of the attitude (radians) and the height (metres) that `step` is given.
    """

    def __init__(
        self,
        picture: MapImage,
        camera: Camera,
        height: float,
        *,
        trust: Trust = Trust(),
        attitude_sigma: float = np.radians(0.4),
        height_sigma: float = 0.02,
    ):
        if not (np.isfinite(height) and height > 0):
            raise ParameterError(f"the usual height is {height} m: expected a number above 0")
        self.height, self.trust = float(height), trust
        self.attitude_sigma, self.height_sigma = attitude_sigma, height_sigma
        self.odometry = VisualOdometry(camera, width=min(_FRAME, camera.width))
        self.camera = self.odometry.camera
        footprint = self.height * camera.width / camera.focal
        self.coarse = CoarseMatcher(
            Ground.from_map(picture, footprint / _COARSE, 0.6 * footprint), self.camera
        )
        self.aligner = Aligner(Ground.from_map(picture, footprint / self.camera.width), self.camera)
        self.belief = CellBelief(_near(self.coarse.ground, 0.3 * footprint))
        self.reset()

    def reset(self) -> None:
        """Forget where the vehicle was."""
        self._pose: np.ndarray | None = None
        self.odometry.reset()
        self._searching = True
        self._fresh = True
        self._last = FloorFix(np.full(6, np.nan), np.full((2, 2), np.inf), 0.0, 0.0, True, False)

    def step(
        self, image: np.ndarray | None, *, attitude=None, height: float | None = None
    ) -> FloorFix:
        """Locate one frame.

        Parameters
        ----------
        image : (H, W, 3) or (H, W) uint8 array or None
            Y, U, V, or luma alone; None for a frame that did not come.
        attitude : (3,) array, optional
            Roll, pitch, yaw in radians as the autopilot measured them.
        height : float, optional
            Metres above the floor, measured.
        """
        if image is None:
            return self._predicted()
        frame = self.odometry.shrunken(image)
        if self._fresh:
            self.belief.reset(
                np.linspace(-np.pi, np.pi, _HEADINGS, endpoint=False)
                if attitude is None
                else [attitude[2]]
            )
        prior, deviation = self._prior(attitude, height)
        if attitude is not None:
            self.belief.headings = np.full(len(self.belief.headings), attitude[2])
        moved, sure = self.odometry.shift(frame)
        self._predict(moved, sure > _SURE, prior)
        self._weigh(frame, prior, everywhere=self._searching)
        fix = self._best(frame, prior, deviation, moved, attitude is None)
        if fix.lost and not self._searching:
            # What it followed is not there: look everywhere, at once.
            if attitude is None:
                self.belief.reset(np.linspace(-np.pi, np.pi, _HEADINGS, endpoint=False))
            self._weigh(frame, prior, everywhere=True)
            fix = self._best(frame, prior, deviation, None, attitude is None)
        self._searching = fix.lost
        self._pose = None if fix.lost else fix.pose
        self._fresh, self._last = False, fix
        return fix

    # -- parts of a step ------------------------------------------------------------------------------

    def _prior(self, attitude, height) -> tuple[np.ndarray, np.ndarray]:
        """Expected pose without a place, and standard deviations."""
        prior = np.array([0, 0, self.height, 0, 0, 0.0])
        deviation = np.array(
            [np.inf, np.inf, _HEIGHT * self.height, _TILT, _TILT, np.pi / _HEADINGS]
        )
        if self._pose is not None:
            prior[[2, 5]] = self._pose[[2, 5]]
            deviation[[2, 5]] = _BETWEEN * (self._pose[2], 1)
        if attitude is not None:
            prior[3:], deviation[3:] = attitude, self.attitude_sigma
        if height is not None:
            prior[2], deviation[2] = height, self.height_sigma
        return prior, deviation

    def _predict(self, moved: np.ndarray, sharp: bool, prior: np.ndarray) -> None:
        metres = moved * prior[2] / self.camera.focal
        cell = self.coarse.ground.cell
        sine, cosine = np.sin(self.belief.headings), np.cos(self.belief.headings)
        right, up = cosine * metres[0] - sine * metres[1], sine * metres[0] + cosine * metres[1]
        self.belief.move(np.column_stack([right, -up]) / cell, 0.5 if sharp else 2.0)

    def _weigh(self, frame: np.ndarray, prior: np.ndarray, everywhere: bool) -> None:
        rows, columns = self.belief.allowed.shape
        window = (slice(0, rows), slice(0, columns)) if everywhere else self.belief.support(_MARGIN)
        fits = []
        for heading in self.belief.headings:
            pose = np.array([*prior[:5], heading])
            correlation, overlap = self.coarse.response(frame, pose, window)
            fits.append(_log_likelihood(correlation, self.trust.coarse * overlap))
        self.belief.weigh(np.array(fits), window)
        self.belief.drop_headings()

    def _best(self, frame, prior, deviation, moved, free_heading: bool) -> FloorFix:
        """Align at the most likely places and take the best of them."""
        modes = self.belief.modes(3, _MODE, 0.02)
        found = []
        for heading, row, column, held in modes:
            start = self._start(prior, heading, row, column, moved)
            spread = deviation.copy()
            expected = start.copy()
            expected[3:5] = prior[3:5]
            aligned = self._aligned(frame, start, expected, spread)
            found.append((aligned, held, row, column))
        gains = [_log_likelihood(np.array(each[0].score), self.trust.fine) for each in found]
        for (_, _, row, column), gain in zip(found, gains, strict=True):
            self.belief.scale(row, column, _MODE, float(np.exp(gain - max(gains))))
        self.belief.normalize()
        weights = [
            held * np.exp(gain - max(gains))
            for (_, held, _, _), gain in zip(found, gains, strict=True)
        ]
        best = int(np.argmax(weights))
        aligned, _, row, column = found[best]
        others = max(0.0, 1 - sum(each[1] for each in found))
        held = weights[best] / (sum(weights) + others)
        if free_heading and aligned.score > self.trust.least:
            nearest = int(np.argmin(abs(_wrapped(self.belief.headings - aligned.pose[5]))))
            self.belief.headings[nearest] = aligned.pose[5]
        lost = held < 0.9 or aligned.score < self.trust.least
        return FloorFix(
            aligned.pose, self._covariance(aligned, lost), aligned.score, held, lost, True
        )

    def _start(self, prior, heading: int, row: int, column: int, moved) -> np.ndarray:
        """The pose whose image centre lies on this cell, or the last one moved on, if it agrees."""
        start = prior.copy()
        start[5] = self.belief.headings[heading]
        cell = self.coarse.ground
        place = cell.to_world([column, row])
        if self._pose is not None and moved is not None:
            last = self._pose.copy()
            metres = moved * last[2] / self.camera.focal
            sine, cosine = np.sin(last[5]), np.cos(last[5])
            center = self._center(last) + [
                cosine * metres[0] - sine * metres[1],
                sine * metres[0] + cosine * metres[1],
            ]
            if np.hypot(*(center - place)) < 2.5 * cell.cell:
                place = center
        start[:2] += place - self._center(start)
        return start

    def _center(self, pose: np.ndarray) -> np.ndarray:
        """The floor point that the image centre shows."""
        return transform_points(
            self.camera.world_from_pixel(pose[:3], pose[3:]), [self.camera.principal_point]
        )[0]

    def _aligned(self, frame, start, expected, deviation) -> Alignment:
        return self.aligner.align(frame, start, expected, deviation)

    def _covariance(self, aligned: Alignment, lost: bool) -> np.ndarray:
        if lost:
            return self.belief.moments()[1] * self.coarse.ground.cell**2
        return self.trust.scale * aligned.covariance[:2, :2] + self.trust.floor * np.eye(2)

    def _predicted(self) -> FloorFix:
        """Without a frame the belief only widens."""
        self.belief.move(np.zeros((len(self.belief.headings), 2)), 2.0)
        self.odometry.reset()
        last = self._last
        step = (2 * self.coarse.ground.cell) ** 2 * np.eye(2)
        self._last = FloorFix(
            last.pose, last.covariance + step, last.score, last.held, last.lost, False
        )
        return self._last


def _near(ground: Ground, reach: float) -> np.ndarray:
    """Cells on the map or within `reach` metres of it: a tilted camera looks beyond its edge."""
    radius = int(np.ceil(reach / ground.cell))
    return cv2.dilate(ground.mask, np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)) > 0


def _log_likelihood(correlation: np.ndarray, pixels) -> np.ndarray:
    """How much likelier a frame is where it correlates so, against where it does not at all.

    The likelihood of Gaussian noise, the image's gain, offset and noise at their most likely values; `pixels`
    is the number of independent ones.
    """
    return -0.5 * pixels * np.log1p(-np.square(np.clip(correlation, 0, 0.995)))


def _wrapped(angle: np.ndarray) -> np.ndarray:
    return (angle + np.pi) % (2 * np.pi) - np.pi
