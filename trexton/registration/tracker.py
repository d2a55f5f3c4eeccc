"""Frame after frame on the floor: correlation says where about, alignment where exactly. Offers
`FloorTracker`, which follows the vehicle and finds it again."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import ArrayLike

from trexton.registration.alignment import Aligner, Alignment, Candidate
from trexton.registration.belief import KNOWN, PATIENCE, SURE, CellBelief, ViewMotion, Window
from trexton.registration.ground import FRAME, CoarseMatcher, Ground, fine_cell
from trexton.registration.prior import ALL_HEADINGS, PosePrior, Seen
from trexton.registration.trust import FloorFix, Trust
from trexton.vision.camera import Camera, MapImage, wrapped
from trexton.vision.visual_odometry import VisualOdometry

_COARSE = 24  # cells that a frame's footprint is wide
_MARGIN = 3  # cells searched around what is believed
_CERTAIN = 0.3  # certainty from which odometry alone may carry the position on
_MODE = 2  # cells around a peak that count as one place
_NEAR = 6  # cells that odometry may be off where a place in doubt is taken
_PLACES, _SHARE = 6, 0.02  # at most so many places of at least this belief is a frame aligned at
_HELD, _ANEW = 0.9, 0.99  # belief from which a place is the place, still or anew
_DRIFT = 0.15  # cells a frame: the error of odometry
_BESIDE = np.ones((5, 5), np.uint8)  # thirds of a cell, two to each side
_WHOLE = 1.65  # times the least score: what a place shows that is taken anew
_KEPT = 0.9  # of the belief, when the floor is not where it should be


class FloorTracker:
    """Locates successive frames on a picture of the floor.

    Parameters
    ----------
    picture : MapImage
    camera : Camera
        Of the frames.
    height : float
        Usual height of the camera in metres; cells and resolutions follow from it.
    trust : Trust, optional
        How good a fix is, by what was learned; else by the defaults.
    attitude_sigma, height_sigma : float
        Standard deviations of the attitude (radians) and the height (metres) that `step` is given.
    alone : bool
        Photographs: each frame is located by itself, whatever came before.
    """

    def __init__(
        self,
        picture: MapImage,
        camera: Camera,
        height: float,
        *,
        trust: Trust | None = None,
        attitude_sigma: float = 0.007,
        height_sigma: float = 0.02,
        alone: bool = False,
    ):
        self.alone, self.height = alone, height
        self.trust = trust or Trust()
        self.attitude_sigma, self.height_sigma = attitude_sigma, height_sigma
        self.odometry = VisualOdometry(camera, FRAME)
        self.camera = self.odometry.camera
        footprint = (cell := fine_cell(camera, self.height)) * self.camera.width
        ground = Ground.from_map(picture, footprint / _COARSE, 0.6 * footprint)
        self.coarse = CoarseMatcher(ground, self.camera)
        self.aligner = Aligner(Ground.from_map(picture, cell), self.camera)
        self.belief = CellBelief(ground.near(0.3 * footprint))
        self._near = _NEAR * ground.cell
        self.reset()

    def reset(self) -> None:
        """Forget where the vehicle was."""
        self.odometry.reset()
        self.pose_prior = PosePrior(self.height, self.attitude_sigma, self.height_sigma)
        self.tilt_bias: np.ndarray | None = None  # of the last frame's attitude; see `TiltError`
        self._pose: np.ndarray | None = None  # of the last frame, if it was found
        self._view = ViewMotion(self.coarse.ground.cell, _COARSE)
        self._missed = PATIENCE  # frames since the floor was last seen where it should be
        self._gone = 0  # frames that did not come since the last that did
        self._last: FloorFix | None = None
        self._carried = False  # whether the pose of the last is one that was found, moved on

    def step(
        self,
        image: np.ndarray | None,
        *,
        attitude: ArrayLike | None = None,
        height: float | None = None,
    ) -> FloorFix:
        """Locate one frame.

        Parameters
        ----------
        image : (H, W, 3) or (H, W) uint8 array or None
            Y, U, V, or luma; None for a frame that did not come: the next is held against the last
            that came, unless more than `PATIENCE` are missing.
        attitude : (3,) array, optional
            Roll, pitch, yaw in radians, NaN where not measured; roll and pitch count together only.
        height : float, optional
            Metres above the floor, measured; one of another order than usual is not believed.
        """
        if image is None:
            return self._without_frame()
        if self.alone:
            self.reset()
        frame = self.odometry.shrunken(image)
        late = self._gone >= PATIENCE
        if late:
            self.odometry.reset()
            self._pose, self._view.velocity, self._missed = None, None, PATIENCE
        steps = min(self._gone, PATIENCE) + 1
        prior = self.pose_prior.prior(attitude, height, self._pose, steps)
        seen = Seen(frame, prior, *self.odometry.shift(frame))
        if self._last is None or late:
            self.belief.reset(prior.headings, kept=_KEPT if late else 0.0)
        elif prior.turned:
            self.belief.headings[:] = prior.mean[5]
        moved = self._predict(seen)
        going = self._moved_on(self._last, moved) if self._last and self._carried else None
        if going is not None and self._doubted:
            place = self.coarse.ground.to_cells(self.aligner.center(going))
            self.belief.expect(place, _NEAR, going[5])
        self._weigh(seen, None if self._searches else self.belief.support(_MARGIN))
        fix, best = self._settle(seen, moved, going)
        if fix.score < self.trust.least and self._missed == 0:
            # Where the last frame seemed to be is no witness of the heading, if that was in doubt.
            headings = ALL_HEADINGS if self._doubted and not prior.turned else prior.headings
            self.belief.reset(headings, kept=_KEPT)
            self._weigh(seen)
            fix, best = self._settle(seen, moved, going)
        if fix.score < self.trust.least:
            fix = self._coast(fix, moved, seen)
        else:
            fix = self._remember(fix, going)
            if not fix.lost:
                self.pose_prior.learn(prior, best)
        self._last = fix
        self._carried = not fix.lost or (self._carried and seen.sure >= SURE)
        self._gone = 0
        self.tilt_bias = None if prior.tilt is None else self.pose_prior.tilt.tilt_bias
        if self.pose_prior.reject(prior, fix, fix.score >= self.trust.least):
            again = self.pose_prior.uses_heading and prior.heading is not None
            self.belief.reset(np.array([prior.heading]) if again else ALL_HEADINGS)
            self._pose = self._view.velocity = None
        return fix

    @property
    def _doubted(self) -> bool:  # the place may then be one that nothing is believed of
        return self._last is None or self._last.lost

    @property
    def _searches(self) -> bool:
        return self._doubted or self._missed > 0

    def _predict(self, seen: Seen) -> np.ndarray:
        """Move the belief; returns the ``(2,)`` cells (column, row) that the last pose moved by."""
        height, cell = seen.prior.mean[2], self.coarse.ground.cell
        right, up = seen.moved * height / self.camera.focal / cell
        last_heading = 0.0 if self._last is None else self._last.pose[5]
        headings = np.append(self.belief.headings, last_heading)
        sine, cosine = np.sin(headings), np.cos(headings)
        shift = np.stack([cosine * right - sine * up, -sine * right - cosine * up], axis=-1)
        last = None if self._last is None else shift[-1]
        shift, sigma = self._view.predicted(shift, last, seen.sure, seen.prior.steps)
        self.belief.move(shift[:-1], sigma)
        if self._pose is None and last is not None:
            shift = last[None] * (seen.sure >= _CERTAIN)
        return np.asarray(shift[-1])

    def _weigh(self, seen: Seen, window: Window | None = None) -> None:
        """Multiply the belief by how well the frame fits inside a window, or anywhere."""
        fits = []
        for heading in self.belief.headings:
            pose = np.array([*seen.prior.mean[:5], heading])
            correlation, overlap = self.coarse.response(seen.frame, pose, window)
            if not self.alone:  # between two cells a fine pattern fits neither
                finer = cv2.resize(correlation, None, fx=3, fy=3, interpolation=cv2.INTER_LANCZOS4)
                correlation = cv2.dilate(finer, _BESIDE)[1::3, 1::3]
            fits.append(self.trust.gain(correlation, self.trust.coarse * overlap))
        self.belief.weigh(np.array(fits), window or (slice(None), slice(None)))
        self.belief.drop_headings()

    def _candidates(self, seen: Seen, moved: np.ndarray) -> list[Candidate]:
        """Align the frame at the most likely places, and where the last pose moved to."""
        starts, continued = [], -1
        # As long as it is lost, a place is worth a look however little is believed of it.
        share = 0.0 if self._searches else _SHARE
        for heading, row, column, held in self.belief.modes(_PLACES, _MODE, share):
            starts.append((np.array([column, row]), self.belief.headings[heading], held))
        if self._pose is not None:
            followed = self.coarse.ground.to_cells(self._view.aimed) + moved
            apart = [np.hypot(*(place - followed)) for place, _, _ in starts]
            nearest = int(np.argmin(apart))
            held = starts[nearest][2]
            if not apart[nearest] < _MODE + 0.5:
                nearest, held = len(starts), self.belief.around(followed, _MODE)
            starts[nearest : nearest + 1] = [(followed, seen.prior.mean[5], held)]
            continued = nearest
        candidates = []
        for index, (place, heading, held) in enumerate(starts):
            start = np.array([*seen.prior.mean[:5], heading])
            start[:2] = self.coarse.ground.to_world(place) - self.aligner.center(start)
            deviation = seen.prior.deviation
            if index == continued:
                deviation = np.array([*[KNOWN * self.coarse.ground.cell] * 2, *deviation[2:]])
            aligned = self.aligner.align(seen.frame, start, deviation)
            candidates.append(Candidate(place, held, aligned))
        return candidates

    def _settle(
        self, seen: Seen, moved: np.ndarray, going: np.ndarray | None
    ) -> tuple[FloorFix, Alignment]:
        """Weigh the candidates by how well they fit once aligned, and take the best."""
        candidates = self._candidates(seen, moved)
        scores = np.array([each.aligned.score for each in candidates])
        gains = self.trust.gain(scores, self.trust.fine)
        factors = np.exp(gains - gains.max())
        weights = factors * [each.held for each in candidates]
        if len(candidates) > 1:
            for each, factor in zip(candidates, factors, strict=True):
                self.belief.scale(each.place, _MODE, float(factor))
            self.belief.normalize()
        chosen = candidates[int(np.argmax(weights))]
        best = chosen.aligned
        others = max(0.0, 1 - sum(each.held for each in candidates))
        if self.alone:  # no motion will rule them out: they fit no better than the second best
            others *= float(np.sort(factors)[-2:][0])
        held = float(weights.max() / (weights.sum() + others))
        if best.score >= self.trust.least:
            self._view.aim(self.aligner.center(best.pose))
            place = self.coarse.ground.to_cells(self._view.aimed)
            self.belief.sharpen(place, chosen.place, _MODE)
            if not seen.prior.turned:
                # The others are as far from the grid, and turn with the vehicle as well.
                apart = wrapped(best.pose[5] - self.belief.headings)
                self.belief.headings += apart[int(np.argmin(abs(apart)))]
        far = going is not None and np.hypot(*(best.pose - going)[:2]) > self._near
        anew = not self.alone and (self._doubted or far)
        least = self.trust.least * (_WHOLE if anew else 1)
        lost = held < (_ANEW if anew else _HELD) or best.score < least
        covariance = self.trust.covariance(best.covariance)
        if lost:
            covariance = self.belief.moments()[1] * self.coarse.ground.cell**2
        alone = not lost and not seen.prior.turned  # a compass must not get its own yaw back
        sigma = self.trust.heading_sigma(best.covariance, self.height) if alone else np.nan
        return FloorFix(best.pose, covariance, best.score, lost, True, sigma), best

    def _coast(self, fix: FloorFix, moved: np.ndarray, seen: Seen) -> FloorFix:
        """The floor was not recognized, `fix` is lost: move the last pose on, soon lost."""
        self._missed = min(self._missed + 1, PATIENCE)
        last = self._last
        if self._pose is None or self._missed == PATIENCE or last is None:
            if self._pose is not None and not seen.prior.turned:
                self.belief.reset(ALL_HEADINGS)
            self._pose = self._view.velocity = None
            if last is not None and self._carried:
                fix = replace(fix, pose=self._moved_on(last, moved))
            return fix
        self._pose = self._moved_on(last, moved)
        self._view.aimed = self.aligner.center(self._pose)
        drift = _DRIFT * seen.prior.steps * self.coarse.ground.cell
        wider = last.covariance + drift**2 * np.eye(2)
        lost = last.lost or seen.sure < _CERTAIN
        return replace(fix, pose=self._pose, covariance=wider, lost=lost)

    def _remember(self, fix: FloorFix, going: np.ndarray | None) -> FloorFix:
        """The floor was recognized at `fix`; while that is in doubt, odometry says better where."""
        if not fix.lost:
            self._view.velocity = None
            if self._pose is not None and self._missed == 0:
                self._view.learn(self._gone + 1)
        self._pose, self._missed = fix.pose, 0
        return fix if going is None or not fix.lost else replace(fix, pose=going)

    def _moved_on(self, last: FloorFix, moved: np.ndarray) -> np.ndarray:
        """The pose of the last fix, so many cells on."""
        return last.pose + np.pad(moved * (1, -1) * self.coarse.ground.cell, (0, 4))

    def _without_frame(self) -> FloorFix:
        """On as before, less and less surely; the belief waits for the next frame."""
        self.tilt_bias = None
        last, cell = self._last, self.coarse.ground.cell
        if last is None:
            return FloorFix(np.full(6, np.nan), np.diag([np.inf, np.inf]), 0, True, False)
        self._gone += 1
        pose = last.pose.copy()
        moved, strays = self._view.ahead(min(self._gone, PATIENCE))
        pose[:2] += moved
        wider = last.covariance + (strays * self._gone * cell) ** 2 * np.eye(2)
        lost = last.lost or self._gone >= PATIENCE
        return replace(
            last, pose=pose, covariance=wider, lost=lost, observed=False, heading_sigma=np.nan
        )
