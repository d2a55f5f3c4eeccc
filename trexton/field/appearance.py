"""How the floor looks in flight, as a role of a method: as it is, or followed by a filter under
another light, in shadow, from another heading or height than when it was surveyed, which takes that
out of each frame before it is counted.

A few states are tried on patches of the frame, each weighted by the field's likelihood of the
corrected histogram, summed over the floor. Their moments are the next state (assumed density
filtering by importance sampling). While frames fit no place, states from all over the prior compete
for a few frames.
"""

from dataclasses import dataclass
from math import isqrt
from typing import Self

import numpy as np

from trexton.base.errors import MapError
from trexton.field.field import Field, FrameEvidence
from trexton.field.likelihood import better_half
from trexton.localization.base import Part, learned
from trexton.localization.estimate import Estimate
from trexton.localization.texton_map import TextonMap
from trexton.localization.training_set import Training
from trexton.vision.correction import HEADING, HEIGHT, STATES, FrameMotion, affine, corrected_frame

HELD = 0.98  # mean resultant length of the yaw of a survey that held its heading
TRIALS, PATCHES = 16, 300  # states tried about the last one, and on how many patches of a frame
PRIOR_SIGMA = np.array([0.25, 0.04, 0.04, 0.0, 0.1])  # about the survey; of any heading
START_SIGMA = np.array([0.08, 0.02, 0.02, 0.1, 0.04])  # about a state that was just chosen
FOLLOW_SIGMA = np.array([0.03, 0.01, 0.01, 0.01, 0.02])  # at most, while it is followed
MIN_SIGMA = np.array([0.006, 0.002, 0.002, 0.001, 0.004])  # what the patches of a frame resolve
WALK = np.array([0.006, 0.002, 0.002, 0.0005, 0.004])  # a frame; a heading is seen to turn
TURN_SHARE = 0.1  # of a turn, by which that is seen too small or too large
GROUPS = np.array([[1, 1, 1, 0, 0], [0, 0, 0, 1, 0], [0, 0, 0, 0, 1]], dtype=bool)
GATE = np.array([20.0, 10.0, 30.0])  # log Bayes factors against the survey's, from which on each
# group is taken out
CHOSEN_FACTOR = 40.0  # of a state that was just chosen
FACTOR_LIMITS = (-6.0, 120.0)
GATE_MEMORY = 0.92  # of that factor, an update
RETURN = np.array([0.8, 0.8, 0.8, 0.98, 0.8])  # to the survey, a step, where nothing speaks
DEADBAND = np.array([0.04, 0.015, 0.015, 0.1, 0.06])  # below, a frame is taken as it is
EVIDENCE_SHARE = 0.25  # of a frame: its neighbours err alike
WIDENED = 1.3  # proposals, over the state's own deviation
SEARCH_FRAMES = 8  # over which the evidence of states from the prior is summed
SEARCH_STATES = 192
SEARCH_KEPT, SEARCH_CHILDREN = 12, 3  # states that go on from frame to frame, and beside each
SEARCH_PENALTY = 10.0  # log evidence, of each group that is not as it was last
MISFIT = 1.25  # average normalized residual of corrected frames from which on they fit no place
BACK_FRAMES = 2  # on end, that fit as before a search and end it
RESIDUAL_GAIN = 0.3  # of that average, a frame
SETTLED_EVERY = 3  # frames between updates while frames fit well
UNFAMILIAR = 0.9  # average normalized residual up to which they do
LOST_FRAMES = 25  # on end, after which all is searched anew
TILE_MISFIT = 1.8  # normalized residual of a tile from which on it may lie in another light
TILE_PENALTY = 12.0  # log evidence, of a tile that is in another light than the frame
TILE_LEVELS = np.arange(-18, 19) / 20  # brightnesses that are tried for tiles, log gains
MIN_LEVEL = 0.12  # log gain of a tile


class AppearanceFilter:
    """`Tracked` in flight.

    Attributes
    ----------
    mean : (5,) array
        Brightness, warmth, tint (log gains), heading (radians), log height.
    covariance : (5, 5) array
    levels : (C,) array
        Brightness of each tile of the image beside that of the frame, a log gain.
    settled : bool
        Whether a state was chosen: while frames fit no place, none is.
    """

    covariance: np.ndarray

    def __init__(self, texton_map: TextonMap, rng: np.random.Generator, survey_yaw: float):
        self._survey_yaw, self._rng = survey_yaw, rng
        self._evidence = FrameEvidence(texton_map, PATCHES, rng)
        self._offsets = texton_map.parts["measurement"].offsets
        drawn = self._rng.standard_normal((TRIALS, STATES))
        drawn -= drawn.mean(axis=0)
        root = np.linalg.cholesky(np.cov(drawn.T))
        self._proposals = np.vstack([0 * drawn[:1], drawn @ np.linalg.inv(root).T])
        self.reset()

    def reset(self) -> None:
        """As at the start: the floor is taken to look as surveyed, until frames fit no place."""
        self._choose(np.zeros(STATES))
        self._motion, self._moved = FrameMotion(), np.zeros(4)
        self._evidence.near(None)
        self._bank: np.ndarray | None = None
        self._last = np.zeros(STATES)  # before a search
        self._lost, self._residual = 0, 0.5

    def locate(self, estimate: Estimate) -> None:
        """Tell where the last frame was taken: the next is sought there first."""
        self._lost = self._lost + 1 if estimate.lost else 0
        self._evidence.near(estimate)

    @property
    def settled(self) -> bool:
        return self._bank is None

    def corrected(self, frame: np.ndarray) -> np.ndarray:
        """``(H, W, 3) uint8``: a frame as it would look as surveyed; itself where it does."""
        return corrected_frame(frame, self._used, self.levels)

    @property
    def _used(self) -> np.ndarray:
        """``(5,)``: the state, during a search the last; as surveyed where that will do."""
        if self._bank is not None:
            return self._last
        needed = (GROUPS[self._factors > GATE]).any(axis=0)
        return np.where(needed & (np.abs(self.mean) >= DEADBAND), self.mean, 0)

    def velocity(self, frame: np.ndarray, since: float) -> np.ndarray | None:
        """``(2,)`` metres a second that the next ``(H, W, 3) uint8`` frame shows, so many seconds
        since the last; None where it shows none.

        How many metres the frame's sides are long is known by the footprints of its tiles.
        """
        moved = self._motion.step(frame)
        self._moved = np.zeros(4) if moved is None else moved
        offsets, side = self._offsets, isqrt(len(self._offsets))
        if moved is None or side < 2 or since <= 0:
            return None
        sides = side * np.array([offsets[1] - offsets[0], offsets[side] - offsets[0]])  # metres
        shape = np.array(frame.shape[1::-1])
        seen = np.linalg.solve(affine(frame.shape, self._used)[:, :2], moved[2:] * shape) / shape
        return -seen @ sides / since

    def update(self, frame: np.ndarray, yaw: float | None = None) -> None:
        """One ``(H, W, 3) uint8`` frame later; with a yaw, radians, the heading is known by it."""
        walk, turn = WALK.copy(), self._moved[0]
        walk[HEADING] += TURN_SHARE * abs(turn)
        self.mean[HEADING] += turn
        covariance = self.covariance + np.diag(np.square(walk))
        wide = np.maximum(1, np.sqrt(np.diag(covariance)) / self._most)
        self.covariance = covariance / np.outer(wide, wide)
        if self._bank is not None:
            self._bank[:, HEADING] += turn
            self._last[HEADING] += turn
        self._active = np.arange(STATES)
        if yaw is not None and np.isfinite(self._survey_yaw):
            heading = np.arctan2(*(f(yaw - self._survey_yaw) for f in (np.sin, np.cos)))
            self.mean[HEADING], self._active = heading, np.delete(self._active, HEADING)
            self._factors[1] = np.inf
            if self._bank is not None:
                self._bank[:, HEADING] = self._last[HEADING] = heading
        if self._bank is not None:
            self._select(frame, self._bank)
        elif self._wait:
            self._wait -= 1
        else:
            self._follow(frame)

    def _choose(self, state: np.ndarray) -> None:
        self.mean, self.covariance = state, np.diag(np.square(START_SIGMA))
        self.levels = np.zeros(len(self._offsets))
        chosen = (GROUPS & (state != 0)).any(axis=1)
        self._factors: np.ndarray = np.where(chosen, CHOSEN_FACTOR, 0.0)  # log Bayes factors
        self._most: np.ndarray = START_SIGMA  # deviations at most
        self._wait: int = 0  # frames until the next update

    def _search(self) -> None:
        """Begin anew with states of the prior, the last one and that of the survey among them."""
        count, self._last = SEARCH_STATES, self._used
        self._bank = bank = np.tile(self._last, (count, 1))
        drawn = self._rng.standard_normal((count, STATES)) * PRIOR_SIGMA
        drawn[:, 0] = PRIOR_SIGMA[0] * np.linspace(-2.5, 2.5, count)
        kind = np.arange(count) % 4
        bank[kind < 3, :HEADING] = drawn[kind < 3, :HEADING]
        around = np.pi * (2 * (np.arange(count) + self._rng.uniform()) / count - 1)
        bank[:, HEADING] = np.where(kind > 1, self._rng.permutation(around), self._last[HEADING])
        bank[::5, HEIGHT] = drawn[::5, HEIGHT]
        bank[0], bank[1] = self._last, 0
        self._scores = -SEARCH_PENALTY * (GROUPS @ (bank != self._last).T).sum(axis=0)
        self._scores[:2] = 0
        self._back = -SEARCH_FRAMES if self._lost >= LOST_FRAMES else 0  # they fitted all the while
        self._left, self._lost = SEARCH_FRAMES, 0

    def _select(self, frame: np.ndarray, bank: np.ndarray) -> None:
        """Sum up the evidence of the states of a search, the best of which go on with some beside
        them; the best of all is the state meanwhile.
        """
        evidence, residuals = self._evidence(frame, np.vstack([bank, self._last]), self.levels)
        again = float(better_half(residuals[-1]))  # a rug, say, may lie behind
        self._back = self._back + 1 if again < MISFIT else min(self._back, 0)
        if self._back == BACK_FRAMES:
            self._choose(self._last)
            self._bank, self._residual = None, again
            return
        self._scores += evidence[:-1]
        self._left -= 1
        best = np.argsort(-self._scores, kind="stable")[:SEARCH_KEPT]
        self._residual += RESIDUAL_GAIN * (float(residuals[best[0]].mean()) - self._residual)
        self._choose(bank[best[0]].copy())
        parents = np.tile(bank[best], (SEARCH_CHILDREN + 1, 1))
        children = self._rng.standard_normal(parents.shape) * START_SIGMA
        children[:SEARCH_KEPT] = 0
        children[:, HEADING:][parents[:, HEADING:] == 0] = 0  # those of the survey are kept exactly
        shrink = (self._left + 1) / SEARCH_FRAMES
        self._bank = parents + shrink * children
        self._scores = np.tile(self._scores[best], SEARCH_CHILDREN + 1)
        if not self._left and self._residual < MISFIT:
            self._bank = None
        elif not self._left:
            self._search()

    def _follow(self, frame: np.ndarray) -> None:
        """Moments of states about the last one, weighted by their evidence."""
        active = self._active
        root = np.linalg.cholesky(self.covariance[np.ix_(active, active)])
        states = np.tile(self.mean, (len(self._proposals), 1))
        states[:, active] += WIDENED * self._proposals[:, active] @ root.T
        without = np.where(GROUPS, 0, self.mean)
        evidence, residuals = self._evidence(frame, np.vstack([states, without]), self.levels)
        evidence, others = np.split(evidence, [len(states)])
        self._factors = np.clip(GATE_MEMORY * self._factors + evidence[0] - others, *FACTOR_LIMITS)
        tiles = residuals[evidence.argmax()]
        if len(tiles) > 1 and tiles.max() > TILE_MISFIT:
            self._set_levels(frame)
        residual = float(better_half(tiles))
        self._residual += RESIDUAL_GAIN * (residual - self._residual)
        if self._lost >= LOST_FRAMES or self._residual > MISFIT:
            self._search()
        elif residual < 1:  # else it shows something new, a rug say, and nothing of the light
            self._moments(states, evidence)
            back = GROUPS[self._factors < 0].any(axis=0)
            self.mean[back] *= RETURN[back]
            self._most = FOLLOW_SIGMA
            self._wait = SETTLED_EVERY - 1 if self._residual < UNFAMILIAR else 0

    def _moments(self, states: np.ndarray, evidence: np.ndarray) -> None:
        """Take the moments of `states` ``(S, 5)``, weighted by their log evidence ``(S,)``."""
        squared = np.square(self._proposals[:, self._active]).sum(axis=1)
        log_weights = EVIDENCE_SHARE * evidence - 0.5 * (WIDENED**2 - 1) * squared
        light = states[:, :HEADING] / PRIOR_SIGMA[:HEADING]  # without, it drifts with the floor
        log_weights -= 0.5 * np.square(light).sum(axis=1)
        weights = np.exp(log_weights - log_weights.max())
        weights /= weights.sum()
        self.mean = weights @ states
        offset = states - self.mean
        self.covariance = (offset * weights[:, None]).T @ offset + np.diag(np.square(MIN_SIGMA))
        self.mean[HEADING] = (self.mean[HEADING] + np.pi) % (2 * np.pi) - np.pi

    def _set_levels(self, frame: np.ndarray) -> None:
        """The likeliest brightness of each tile, at the likeliest place near the last one.

        Once most of the tiles are in another light, it is that of the frame.
        """
        states = self.mean + np.outer(TILE_LEVELS, np.eye(STATES)[0])
        penalties = TILE_PENALTY * (TILE_LEVELS != 0)
        levels = TILE_LEVELS[self._evidence.best_of_tiles(frame, states, penalties)]
        middle = float(np.median(levels))
        if abs(middle) > MIN_LEVEL:
            self.mean[0] += middle
            levels = levels - middle
            self._factors[0] = CHOSEN_FACTOR
        self.levels = np.where(np.abs(levels) < MIN_LEVEL, 0, levels)


class Appearance(Part):
    """Base of all that take the appearance of the floor out of a frame."""

    def open(self, texton_map: TextonMap, rng: np.random.Generator) -> AppearanceFilter | None:
        """For one flight; None where frames are taken as they are."""
        return None


class AsSurveyed(Appearance):
    """Frames are taken as they are, as in the paper."""


@dataclass(eq=False)
class Tracked(Appearance):
    """Follows light, heading and height by the evidence of a field; nothing of histograms."""

    needs = {"measurement": Field}
    survey_yaw: np.ndarray = learned()  # () radians, of a survey that held its heading; else NaN

    def fit(self, training: Training) -> Self:
        """Learn the heading of the survey, from which a yaw in flight is counted."""
        flight, yaw = training.flight, np.nan
        if flight is not None and flight.attitude is not None:
            turned = flight.attitude[:, 2]
            east, north = np.nanmean([np.cos(turned), np.sin(turned)], 1)
            yaw = float(np.arctan2(north, east)) if np.hypot(east, north) > HELD else np.nan
        return self.with_learned(survey_yaw=np.array(yaw))

    def prepare(self) -> None:
        yaw = self.survey_yaw
        if yaw.shape or yaw.dtype.kind != "f" or np.isinf(yaw):
            raise MapError(f"the survey's yaw is {yaw.dtype} of {yaw.shape}: train the map again")

    def open(self, texton_map: TextonMap, rng: np.random.Generator) -> AppearanceFilter | None:
        if texton_map.dictionary is None:
            return None
        return AppearanceFilter(texton_map, rng.spawn(1)[0], float(self.survey_yaw))
