"""How the floor looks in flight: under another light, or from another heading than when it was
surveyed. A filter follows this appearance and takes it out of each frame before it is counted.

The state is small: log gains of the light (brightness, warmth, tint) and the heading, relative to
the survey's. A few states are tried on patches of the frame. Each is weighted by the evidence of
the field: the likelihood of the corrected histogram, summed over the floor. Their moments are the
next state (assumed density filtering by importance sampling). At the start, and while frames fit no
place, states from all over the prior compete for a few frames. The paper names light and heading as
limits of its method (Discussion).
"""

from __future__ import annotations

from dataclasses import dataclass
from statistics import NormalDist
from typing import Self

import cv2
import numpy as np

from trexton.base.options import option
from trexton.field.field import Field
from trexton.localization.base import Part, learned
from trexton.localization.estimate import Estimate
from trexton.localization.texton_map import TextonMap
from trexton.localization.training_set import Training
from trexton.vision.histograms import patch_histogram
from trexton.vision.patches import gather_patches, sample_positions

__all__ = ["Appearance", "AppearanceFilter", "AsSurveyed", "Tracked"]

# Log gains of blue, green and red by brightness, warmth and tint.
GAINS = np.array([[1.0, -1.0, -0.5], [1.0, 0.0, 1.0], [1.0, 1.0, -0.5]])
HEADING = 3  # in the state, after the gains
PRIOR_SIGMA = np.array([0.2, 0.04, 0.04])  # of the gains
START_SIGMA = np.array([0.08, 0.02, 0.02, 0.1])  # about a state that was just chosen
MIN_SIGMA = np.array([0.006, 0.002, 0.002, 0.004])  # what the patches of a frame can tell
MEMORY_FRAMES = 400  # time constant of the gains' way back to those of the survey
HEADING_WALK = 0.012  # radians a frame
DEADBAND = np.array([0.03, 0.01, 0.01, 0.05])  # below, a frame is taken as it is
WIDENED = 1.3  # proposals, over the state's own deviation
SEARCH_FRAMES = 8  # over which the evidence of states from the prior is summed
SEARCH_STATES = 192
SEARCH_KEPT, SEARCH_CHILDREN = 12, 3  # states that go on from frame to frame, and beside each
SEARCH_PENALTY = 20.0  # log evidence, of a state that is not the last one nor that of the survey
UNFAMILIAR = 0.8  # average normalized residual of corrected frames that are followed each
RESIDUAL_GAIN = 0.3  # of that average, a frame
SETTLED_EVERY = 3  # frames between updates once the state is settled
LOST_FRAMES = 12  # on end, after which light and heading are searched anew
HELD = 0.98  # mean resultant length of the yaw of a survey that held its heading
LOCAL_SHARE = 0.7  # of the evidence that is sought near the last estimate
LOCAL_SIGMA = 0.15  # metres that are added to its deviation
CHROMA_OFFSET = np.array([0, 128, 128], np.float32)


def _yuv_from_bgr() -> np.ndarray:
    unit = cv2.cvtColor(np.eye(3, dtype=np.float32)[None], cv2.COLOR_BGR2YUV)[0]
    return np.asarray(unit.T - [[0.0], [0.5], [0.5]], dtype=float)


_YUV = _yuv_from_bgr()
_BGR = np.linalg.inv(_YUV)


@dataclass(eq=False)
class Appearance(Part):
    """Base of all that take the appearance of the floor out of a frame."""

    def open(self, texton_map: TextonMap, rng: np.random.Generator) -> AppearanceFilter | None:
        """For one flight; None where frames are taken as they are."""
        raise NotImplementedError


@dataclass(eq=False)
class AsSurveyed(Appearance):
    """Frames are taken as they are, as in the paper."""

    def open(self, texton_map: TextonMap, rng: np.random.Generator) -> None:
        return None


@dataclass(eq=False)
class Tracked(Appearance):
    """Follows light, heading and height by the evidence of a field; nothing of histograms."""

    needs = {"measurement": Field}
    trials: int = option(16, "states tried about the last one", low=8, high=1000)
    patches: int = option(300, "of a frame, on which states are tried", low=20, high=100_000)
    turning: bool = option(True, "search the heading too, not only the light")
    survey_yaw: np.ndarray = learned()  # () radians, of a survey that held its heading; else NaN

    def fit(self, training: Training) -> Self:
        """Learn the heading of the survey, from which a yaw in flight is counted."""
        flight, yaw = training.flight, np.nan
        if flight is not None and flight.attitude is not None:
            east, north = np.nanmean(
                [np.cos(flight.attitude[:, 2]), np.sin(flight.attitude[:, 2])], 1
            )
            yaw = float(np.arctan2(north, east)) if np.hypot(east, north) > HELD else np.nan
        return self.with_learned(survey_yaw=np.array(yaw))

    def open(self, texton_map: TextonMap, rng: np.random.Generator) -> AppearanceFilter | None:
        if texton_map.dictionary is None:
            return None
        return AppearanceFilter(self, texton_map, rng)


class AppearanceFilter:
    """`Tracked` in flight.

    Attributes
    ----------
    mean : (4,) array
        Brightness, warmth, tint (log gains), heading (radians).
    covariance : (4, 4) array
    """

    def __init__(self, options: Tracked, texton_map: TextonMap, rng: np.random.Generator):
        self.options, self._map = options, texton_map
        self._field: Field = texton_map.parts["measurement"]
        self._rng = rng.spawn(1)[0]
        drawn = self._rng.standard_normal((options.trials, 4))
        drawn -= drawn.mean(axis=0)
        root = np.linalg.cholesky(np.cov(drawn.T))
        self._proposals = np.vstack([0 * drawn[:1], drawn @ np.linalg.inv(root).T])
        self.reset()

    def reset(self) -> None:
        """As at the start: nothing is known of light and heading."""
        self.mean, self.covariance = np.zeros(4), np.diag(np.square(START_SIGMA))
        self._wait, self._residual = 0, 0.0
        self._near: np.ndarray | None = None
        self._bank: np.ndarray | None = None
        self.jumped = False  # whether places of earlier frames are worth nothing
        self._lost = 0
        self._search()

    def locate(self, estimate: Estimate) -> None:
        """Tell where the last frame was taken: the next is sought there first."""
        self._near, self._lost = None, self._lost + 1 if estimate.lost else 0
        if not estimate.lost:
            offset = self._field.centers - estimate.position
            precision = np.linalg.inv(estimate.covariance + LOCAL_SIGMA**2 * np.eye(2))
            density = np.exp(-0.5 * np.einsum("ni,ij,nj->n", offset, precision, offset))
            share = density / max(float(density.mean()), 1e-300)
            self._near = np.log(LOCAL_SHARE * share + 1 - LOCAL_SHARE)

    @property
    def settled(self) -> bool:
        """Whether a state was chosen: at the start, and after a while of being lost, none is."""
        return self._bank is None

    def corrected(self, frame: np.ndarray) -> np.ndarray:
        """``(H, W, 3) uint8``: a frame as it would look as surveyed; itself where it does."""
        state = np.where(np.abs(self.mean) < DEADBAND, 0, self.mean)
        return corrected_frame(frame, state) if state.any() else frame

    def update(self, frame: np.ndarray, yaw: float | None = None) -> None:
        """One ``(H, W, 3) uint8`` frame later; with a yaw, radians, the heading is known by it."""
        fade = np.r_[np.full(3, np.exp(-1 / MEMORY_FRAMES)), 1.0]
        walk = np.r_[np.square(PRIOR_SIGMA) * (1 - fade[:3] ** 2), HEADING_WALK**2]
        self.mean = fade * self.mean
        self.covariance = self.covariance * np.outer(fade, fade) + np.diag(walk)
        self.jumped = False
        if yaw is not None and self.options.turning and np.isfinite(self.options.survey_yaw):
            heading = np.arctan2(*(f(yaw - self.options.survey_yaw) for f in (np.sin, np.cos)))
            self.mean[HEADING], self._active = heading, np.arange(3)
            if self._bank is not None:
                self._bank[:, HEADING] = heading
        if self._bank is not None:
            self._select(frame, self._bank)
        elif self._wait:
            self._wait -= 1
        else:
            self._follow(frame)

    def _search(self) -> None:
        """Begin anew with states of the prior, the last one and that of the survey among them."""
        count = SEARCH_STATES
        self._bank = bank = np.tile(self.mean, (count, 1))
        drawn = self._rng.standard_normal((count, 3))
        drawn[:, 0] = _strata(count, self._rng)
        bank[::2, :3] = (drawn * PRIOR_SIGMA)[::2]
        if self.options.turning:
            around = np.pi * (2 * (np.arange(count) + self._rng.uniform()) / count - 1)
            held = np.where(np.arange(count) % 4 == 2, bank[:, HEADING], 0)
            free = np.arange(count) % 4 % 3 == 0
            bank[:, HEADING] = np.where(free, self._rng.permutation(around), held)
        bank[0], bank[1] = self.mean, 0
        self._scores = np.full(count, -SEARCH_PENALTY)
        self._scores[:2] = 0
        self._left, self._lost = SEARCH_FRAMES, 0

    def _select(self, frame: np.ndarray, bank: np.ndarray) -> None:
        """Sum up the evidence of the states of a search, the best of which go on with some beside
        them; the best of all is the state meanwhile.
        """
        self._scores += self._evidence(frame, bank)[0]
        self._left -= 1
        best = np.argsort(-self._scores, kind="stable")[:SEARCH_KEPT]
        self._choose(bank[best[0]].copy())
        self.jumped = True
        parents = np.tile(bank[best], (SEARCH_CHILDREN + 1, 1))
        children = self._rng.standard_normal(parents.shape) * START_SIGMA
        children[:SEARCH_KEPT] = 0
        children[parents[:, HEADING] == 0, HEADING] = 0  # the survey's heading is kept exactly
        shrink = (self._left + 1) / SEARCH_FRAMES
        self._bank = parents + shrink * children if self._left else None
        self._scores = np.tile(self._scores[best], SEARCH_CHILDREN + 1)
        self._residual = 0.0

    def _choose(self, state: np.ndarray) -> None:
        self.mean, self.covariance = state, np.diag(np.square(START_SIGMA))
        self._active = np.arange(4 if state[HEADING] else 3)

    def _follow(self, frame: np.ndarray) -> None:
        """Moments of states about the last one, weighted by their evidence."""
        active = self._active
        root = np.linalg.cholesky(self.covariance[np.ix_(active, active)])
        states = np.tile(self.mean, (len(self._proposals), 1))
        states[:, active] += WIDENED * self._proposals[:, active] @ root.T
        evidence, residuals = self._evidence(frame, states)
        residual = float(residuals[evidence.argmax()])
        self._residual += RESIDUAL_GAIN * (residual - self._residual)
        if self._lost >= LOST_FRAMES:
            self._search()
        elif residual < 1:  # else it shows something new, a rug say, and nothing of the light
            self._moments(states, evidence)
            self._wait = SETTLED_EVERY - 1 if self._residual < UNFAMILIAR else 0

    def _moments(self, states: np.ndarray, evidence: np.ndarray) -> None:
        """Take the moments of `states` ``(S, 4)``, weighted by their log evidence ``(S,)``."""
        squared = np.square(self._proposals[:, self._active]).sum(axis=1)
        log_weights = evidence - 0.5 * (WIDENED**2 - 1) * squared
        weights = np.exp(log_weights - log_weights.max())
        weights /= weights.sum()
        self.mean = weights @ states
        offset = states - self.mean
        self.covariance = (offset * weights[:, None]).T @ offset + np.diag(np.square(MIN_SIGMA))
        self.mean[HEADING] = (self.mean[HEADING] + np.pi) % (2 * np.pi) - np.pi

    def _evidence(self, frame: np.ndarray, states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """``(S,)`` log evidence of the frame as each of the ``(S, 4)`` states corrects it, and its
        normalized residual.
        """
        dictionary, parts = self._map.alphabet, self._map.cells
        count = self.options.patches
        positions = sample_positions(frame.shape, dictionary.patch, count, self._rng)
        histograms = np.stack(
            [
                patch_histogram(
                    corrected_patches(frame, positions, dictionary.patch, state),
                    positions,
                    frame.shape,
                    dictionary,
                    parts,
                )
                for state in states
            ]
        )
        tables, deviations = self._field.tables(count), self._field.deviations(histograms)
        log_posterior = tables.log_likelihoods(deviations).sum(axis=0) + self._field.prior
        if self._near is not None and self.settled:
            log_posterior = log_posterior + self._near
        squared = tables.squared_residual(deviations, log_posterior.argmax(axis=1))
        residuals = squared / float(self._field.residual_scale)
        peak = log_posterior.max(axis=1)
        total = np.exp(log_posterior - peak[:, None]).sum(axis=1)
        return peak + np.log(total), residuals


def _strata(count: int, rng: np.random.Generator) -> np.ndarray:
    """``(count,)`` draws of a normal distribution, one from each part of equal probability."""
    shares = (np.arange(count) + rng.uniform()) / max(count, 1)
    return np.array([NormalDist().inv_cdf(each) for each in shares.clip(1e-3, 1 - 1e-3).tolist()])


def _colors(state: np.ndarray) -> np.ndarray:
    """``(3, 3)`` matrix that takes the light's gains out of Y, U - 128, V - 128."""
    return (_YUV * np.exp(-GAINS @ state[:3])) @ _BGR


def _affine(shape: tuple[int, ...], state: np.ndarray) -> np.ndarray:
    """``(2, 3)``: pixels (x, y) of the frame from those it would have as surveyed."""
    cosine, sine = np.cos(state[HEADING]), np.sin(state[HEADING])
    turn = np.array([[cosine, -sine], [sine, cosine]])
    middle = np.array([shape[1] - 1, shape[0] - 1]) / 2
    return np.column_stack([turn, middle - turn @ middle])


def _recolored(pixels: np.ndarray, state: np.ndarray) -> np.ndarray:
    """``(..., 3) uint8`` pixels without the light of a state."""
    if not state[:3].any():
        return pixels
    matrix = _colors(state).astype(np.float32)
    offset = CHROMA_OFFSET - matrix @ CHROMA_OFFSET
    flat = cv2.transform(pixels.reshape(-1, 1, 3), np.column_stack([matrix, offset]))
    return flat.reshape(pixels.shape)


def corrected_patches(
    frame: np.ndarray, positions: np.ndarray, patch: int, state: np.ndarray
) -> np.ndarray:
    """``(N, P, P, 3) uint8`` patches at ``(N, 2)`` positions of the frame as it would look as
    surveyed; what lies outside is mirrored at its border.
    """
    if not state[HEADING]:
        return _recolored(gather_patches(frame, positions, patch), state)
    inside = np.indices((patch, patch)).reshape(2, -1).T
    pixels = (positions[:, None] + inside)[..., ::-1].reshape(-1, 2)
    matrix = _affine(frame.shape, state)
    where = (
        (pixels @ matrix[:, :2].T + matrix[:, 2]).astype(np.float32).reshape(len(positions), -1, 2)
    )
    x, y = np.ascontiguousarray(where[..., 0]), np.ascontiguousarray(where[..., 1])
    taken = cv2.remap(frame, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    return _recolored(taken.reshape(len(positions), patch, patch, 3), state)


def corrected_frame(frame: np.ndarray, state: np.ndarray) -> np.ndarray:
    """``(H, W, 3) uint8``: the frame as it would look as surveyed; see `corrected_patches`."""
    if state[HEADING]:
        frame = cv2.warpAffine(
            frame,
            _affine(frame.shape, state),
            frame.shape[1::-1],
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
            borderMode=cv2.BORDER_REFLECT,
        )
    return _recolored(frame, state)
