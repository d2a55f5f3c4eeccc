"""A filter of a few tracks: Kalman filters over a likelihood on a grid, each an answer to where
the vehicle is.

A track predicts a Gaussian; times the likelihood over the cells it gives a posterior, whose mean
and covariance go back into the track (assumed density filtering; Maybeck, "Stochastic Models,
Estimation and Control", vol. 2, 1982, Sec. 12.7). What the errors of neighbouring frames share is
a state of its own, so that a second look at the same place is not taken for a second opinion. A
track's weight is the evidence of its predictions; where a frame speaks for another place a track
is born there, so a wrong start or a kidnapping is a matter of evidence as well. Places that look
alike mislead frame after frame: where the velocity is told, a track that no frame speaks for is
followed for a while, for it still knows where it is. And a velocity that is told may be wrong, of a
compass beside steel, say: beside the tracks that believe it there are some that learn its error.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from trexton.base.errors import ParameterError
from trexton.field.field import Field
from trexton.field.gaussians import Glimpse
from trexton.field.singer import Singer
from trexton.localization.base import Area
from trexton.localization.estimate import Estimate, Measurement
from trexton.localization.filters import Filter
from trexton.localization.observation import Observation

if TYPE_CHECKING:
    from trexton.localization.texton_map import TextonMap

__all__ = ["TrackFilter", "Tracks"]

MISSED = 1e-3  # share of frames that say nothing about the place, whatever they look like
MISLED_S = 0.2  # seconds after which frames that mislead are down to 1/e; a velocity must be told
DOUBTED = 1e-3  # chance a frame that the velocity goes wrong, or is right again
DOUBTED_S = 2.6  # seconds after which an error that explains nothing is believed 1/e as much
WRONG = 0.3  # metres a second along an axis, of a velocity that is wrong
UNHEARD_OF = 5.0  # standard deviations of a velocity from which on it is not listened to
WRONG_S = 5.0  # seconds after which its error is down to 1/e: it turns with the vehicle
BORN = 1e-3  # chance a frame that the vehicle is elsewhere than its tracks
FAR = 25.0  # log likelihoods this far below the best count as none
APART = 5.0  # cells between the beginnings of two tracks
DOUBT = 0.05  # chance of being somewhere else altogether from which on the vehicle is lost
STRANGE = 2.5  # times as far from every place as frames of the survey: another camera or light
FAMILIAR = 0.8  # the same, from which on errors are larger: frames of what the survey missed
STRANGE_S = 1.0  # seconds over which that is taken
STRANGEST = 10.0  # what a single frame counts for at most
SHARE = 0.02  # of a frame's likelihood that a place must hold for a track to begin there


@dataclass(eq=False)
class Tracks(Filter):
    """The filter of method ``field``.

    Parameters
    ----------
    tracks : int
        How many are kept at most, and as many again that doubt the velocity.
    velocity_sigma : float
        Standard deviation in m/s along an axis of a velocity that comes with a frame, unless it
        brings its own.
    """

    knows_velocity: ClassVar[bool] = True
    tracks: int = 5
    velocity_sigma: float = 0.1

    def check(self) -> None:
        if not 1 <= self.tracks <= 100:
            raise ParameterError(f"{self.tracks} tracks were asked for: expected 1 to 100")
        if not 0 < self.velocity_sigma < np.inf:
            raise ParameterError(
                f"velocity_sigma is {self.velocity_sigma} m/s: expected a positive number"
            )

    def open(
        self, parts: Mapping[str, Any], texton_map: TextonMap, rng: np.random.Generator
    ) -> TrackFilter:
        """A filter that knows nothing yet.

        Raises
        ------
        ParameterError
            Motion or measurement is none that it can take.
        """
        for role, kind in (("motion", Singer), ("measurement", Field)):
            if not isinstance(parts[role], kind):
                raise ParameterError(
                    f"filter 'tracks' was given {type(parts[role]).__name__} for {role}: "
                    f"it needs {kind.__name__}"
                )
        return TrackFilter(
            parts["motion"],
            parts["measurement"],
            texton_map.area,
            self.tracks,
            velocity_sigma=self.velocity_sigma,
        )


class TrackFilter:
    """`Tracks` in flight.

    Parameters
    ----------
    motion : Singer
    measurement : Field
    area : (x_min, x_max, y_min, y_max)
    tracks : int
    velocity_sigma : float
        See `Tracks`.

    Attributes
    ----------
    states : (T, 10) array
        Of each track, best first: position, velocity, acceleration, lasting error of the frames,
        error of the velocity that is told.
    covariances : (T, 10, 10) array
    weights : (T,) array
        Summing to one.
    """

    def __init__(
        self,
        motion: Singer,
        measurement: Field,
        area: Area,
        tracks: int = 5,
        *,
        velocity_sigma: float = 0.1,
    ):
        self.motion, self.measurement, self.area, self.tracks = motion, measurement, area, tracks
        self.velocity_sigma = velocity_sigma
        errors = measurement.error_model
        period_s = float(motion.period_s)
        memory, wrong = np.exp(-period_s / errors.lasts_s), np.exp(-period_s / WRONG_S)
        self._transition = np.diag([0.0] * 6 + [memory] * 2 + [wrong] * 2)
        self._transition[:6, :6] = motion.transition
        self._noise = np.diag([0.0] * 6 + [errors.lasting**2 * (1 - memory**2)] * 2 + [0.0] * 2)
        self._noise[:6, :6] = motion.noise
        self._rest = np.diag([*motion.rest, *[errors.lasting**2] * 2, 0.0, 0.0])
        self._wrong = np.diag([0.0] * 8 + [WRONG**2] * 2)
        self._seen, self._told = np.zeros((2, 10)), np.zeros((2, 10))
        self._seen[:, :2] = self._seen[:, 6:8] = np.eye(2)  # the position and the lasting error
        self._told[:, 2:4] = self._told[:, 8:] = np.eye(2)  # the velocity and its error
        self._fresh = errors.fresh**2 * np.eye(2)
        self._fading = 1 - np.exp(-period_s / STRANGE_S)
        self._independent_s = errors.independent_s(period_s)
        self._grain = measurement.cell**2 / 12 * np.eye(2)  # a cell is a square, not a point
        x_min, x_max, y_min, y_max = area
        self._log_area = np.log((x_max - x_min) * (y_max - y_min))
        self.reset()

    def reset(self) -> None:
        """Forget where the vehicle was."""
        self.states, self.covariances = np.empty((0, 10)), np.empty((0, 10, 10))
        self.weights = np.empty(0)
        self._misled = np.empty(0)  # chance that the last frame misled, if the track is right
        self._missed = 0
        self._strange = 0.5  # of the latest frames, see `Field.strangeness`
        self._off: np.ndarray | None = None  # metres a second, of the velocity that was told

    def step(self, observation: Observation | None) -> None:
        """Advance one frame; None where nothing was observed: predict only.

        Raises
        ------
        ParameterError
            A velocity is told that is none along two axes.
        """
        self._off = None
        if observation is None:
            self._predict()
            return
        found = self.measurement.over_cells(observation)
        peak = found.max()
        kept = np.flatnonzero(found > peak - FAR)
        cells, shares = self.measurement.centers[kept], np.exp(found[kept] - peak)
        shares /= shares.sum()
        sigma = observation.aiding.velocity_sigma or self.velocity_sigma
        told = observation.aiding.velocity
        velocity = None if told is None else self._plausible(told, sigma)
        strange = min(self.measurement.strangeness(observation, found), STRANGEST)
        self._strange += (strange - self._strange) * self._fading
        if velocity is not None:
            self._doubt()
        self._predict()
        if velocity is not None:
            self._be_told(velocity, sigma**2 * np.eye(2))
        begun = len(self.states) > 0
        evidence, looked_at = self._correct(cells, shares)
        log_weights = np.log(self.weights) + self._log_chance(evidence, velocity is not None)
        places = self._births(cells, shares, looked_at)
        if places:
            chance = np.log(BORN) if begun else 0.0
            states, covariances, masses = (np.array(column) for column in zip(*places, strict=True))
            self._begin(states, covariances, np.zeros(len(masses)))
            log_weights = np.concatenate([log_weights, np.log(masses) + chance])
        if not len(log_weights):  # the frame speaks for no place, nor did one before
            return
        self._keep(log_weights)
        if velocity is not None and self.doubts[0]:
            self._off = self.states[0, 8:].copy()
        elif told is not None and velocity is None:
            self._off = told - self.states[0, 2:4]

    def _plausible(self, told: np.ndarray, sigma: float) -> np.ndarray | None:
        """A velocity that this vehicle might have, or be told wrongly; None where it is neither."""
        velocity = np.asarray(told, dtype=float)
        if velocity.shape != (2,):
            raise ParameterError(
                f"a velocity of shape {velocity.shape} was told: expected (2,), metres a second "
                "in the map's axes"
            )
        usual = np.sqrt(float(self.motion.speed) ** 2 + WRONG**2 + sigma**2)
        return velocity if np.abs(velocity).max() <= UNHEARD_OF * usual else None

    @property
    def doubts(self) -> np.ndarray:
        """``(T,)`` whether a track takes the velocity that is told to be wrong."""
        found: np.ndarray = self.covariances[:, 8, 8] > 0
        return found

    def _begin(self, states: np.ndarray, covariances: np.ndarray, misled: np.ndarray) -> None:
        self.states = np.concatenate([self.states, states])
        self.covariances = np.concatenate([self.covariances, covariances])
        self._misled = np.concatenate([self._misled, misled])

    def _doubt(self) -> None:
        """Beside each track that has none near, one begins that takes the velocity for wrong where
        the track believes it, and for right where it does not."""
        doubts, places = self.doubts, self.states[:, :2]
        offset = places[:, None] - places
        near = np.hypot(offset[..., 0], offset[..., 1]) < 2 * APART * self.measurement.cell
        alone = np.flatnonzero(~(near & (doubts[:, None] != doubts)).any(axis=1))
        states, covariances = self.states[alone], self.covariances[alone]
        states[:, 8:] = covariances[:, 8:] = covariances[:, :, 8:] = 0
        covariances[~doubts[alone]] += self._wrong
        self._begin(states, covariances, self._misled[alone])
        weights = np.concatenate([self.weights, DOUBTED * self.weights[alone]])
        self.weights = weights / weights.sum()

    def _predict(self) -> None:
        grown = np.where(self.doubts, 1 - self._transition[8, 8] ** 2, 0.0)
        self.states = self.states @ self._transition.T
        covariances = self._transition @ self.covariances @ self._transition.T + self._noise
        self.covariances = covariances + grown[:, None, None] * self._wrong

    def _be_told(self, velocity: np.ndarray, measured: np.ndarray) -> None:
        """Take a velocity that something else measured, with its ``(2, 2)`` covariance.

        A track that it contradicts loses weight, against one of which no velocity is known. If it
        is wrong it speaks for no track: those that doubt it gain as much as the one that gains
        most, a little less each time.
        """
        if not len(self.states):
            return
        doubts = self.doubts
        glimpse = Glimpse.of(self.states, self.covariances, self._told, measured)
        offset = velocity - glimpse.expected
        self.states, self.covariances = glimpse.after(velocity)
        unknown = self._rest[2:4, 2:4] + measured
        squared = np.einsum("ti,tij,tj->t", offset, glimpse.precision, offset)
        squared -= velocity @ np.linalg.solve(unknown, velocity)
        ratio = np.linalg.det(glimpse.precision) * np.linalg.det(unknown)
        chance = np.maximum(np.sqrt(ratio) * np.exp(-0.5 * squared), MISSED)
        chance[doubts] = np.exp(-float(self.motion.period_s) / DOUBTED_S) * chance.max()
        weights = self.weights * chance
        self.weights = weights / weights.sum()

    def _correct(self, cells: np.ndarray, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Evidence of the frame for each track, against a place drawn from the whole area, and
        ``(T, 2)`` places where they saw it.
        """
        if not len(self.states):
            return np.empty(0), np.empty((0, 2))
        glimpse = Glimpse.of(self.states, self.covariances, self._seen, self._fresh)
        expected, precision = glimpse.expected, glimpse.precision
        offset = cells - expected[:, None]
        squared = np.einsum("tmi,tmi->tm", offset @ precision, offset)
        joint = shares * np.exp(-0.5 * squared)
        mass = joint.sum(axis=1)
        norm = self._log_area - np.log(2 * np.pi) + 0.5 * np.log(np.linalg.det(precision))
        evidence = mass * np.exp(norm)
        hit = evidence > MISSED
        self._missed = 0 if hit[0] else self._missed + 1
        joint /= np.where(mass > 0, mass, 1)[:, None]
        mean = np.where(hit[:, None], joint @ cells, expected)
        offset = cells - mean[:, None]
        after = (offset * joint[..., None]).transpose(0, 2, 1) @ offset + self._grain
        after = np.where(hit[:, None, None], after, glimpse.spread)
        self.states, self.covariances = glimpse.after(mean, after)
        return evidence, mean

    def _log_chance(self, evidence: np.ndarray, told: bool) -> np.ndarray:
        """Log of the chance of the frame, if a track is right.

        A frame that misleads speaks for the place for which the last one spoke: of what it says for
        another track it takes nothing away. Without a velocity a track that sees nothing soon knows
        nothing either, and each frame counts anew.
        """
        if not told:
            self._misled = np.zeros(len(evidence))
            chance: np.ndarray = np.log(evidence + MISSED)
            return chance
        stays = np.exp(-float(self.motion.period_s) / MISLED_S)
        misled = MISSED + (stays - MISSED) * self._misled
        mislead = misled * max(1.0, float(evidence.max(initial=0.0)))
        total = (1 - misled) * evidence + mislead
        self._misled = mislead / total
        chance = np.log(total)
        return chance

    def _births(
        self, cells: np.ndarray, shares: np.ndarray, looked_at: np.ndarray
    ) -> list[tuple[np.ndarray, np.ndarray, float]]:
        """States, covariances, shares of tracks that begin at the frame's likeliest places."""
        born, left = [], shares.copy()
        apart = APART * self.measurement.cell
        for _ in range(2):
            best = int(left.argmax())
            near = np.hypot(*(cells - cells[best]).T) < 2 * apart
            mass = float(left[near].sum())
            if mass < SHARE:
                break
            part = left[near] / mass
            left[near] = 0
            mean = part @ cells[near]
            if len(looked_at) and np.hypot(*(looked_at - mean).T).min() < apart:
                continue
            offset = cells[near] - mean
            covariance = self._rest.copy()
            covariance[:2, :2] = (offset.T * part) @ offset + self._grain + self._fresh
            # The place is where the frame was seen: the position is that less the lasting error.
            covariance[:2, :2] += self._rest[6:8, 6:8]
            covariance[:2, 6:8] = covariance[6:8, :2] = -self._rest[6:8, 6:8]
            born.append((np.concatenate([mean, np.zeros(8)]), covariance, mass))
        return born

    def _keep(self, log_weights: np.ndarray) -> None:
        """The best tracks that say different things, weights summing to one."""
        kept: list[int] = []
        apart, speed = 0.25 * APART * self.measurement.cell, 0.5 * float(self.motion.speed)
        doubts = self.doubts
        for track in np.argsort(-log_weights, kind="stable"):
            alike = [other for other in kept if doubts[other] == doubts[track]]
            if len(alike) == self.tracks:
                continue
            offset = self.states[alike] - self.states[track]
            far = np.hypot(offset[:, 0], offset[:, 1]) > apart
            if (far | (np.hypot(offset[:, 2], offset[:, 3]) > speed)).all():
                kept.append(int(track))
        weights = np.exp(log_weights[kept] - log_weights[kept[0]])
        rows = np.array(kept)[weights > 1e-6]
        weights = weights[weights > 1e-6]
        if rows[0] != 0:
            self._missed = 0
        self.states, self.covariances = self.states[rows], self.covariances[rows]
        self._misled = self._misled[rows]
        self.weights = weights / weights.sum()

    def estimate(self) -> Estimate:
        """Position of the best track, and the covariance of all about it, larger where the field
        knows less than where its errors were learned, and while frames are unlike the survey's.

        It is lost while tracks that are elsewhere may be right, no frame speaks for it, or the
        frames look like no place of the survey.
        """
        if not len(self.states):
            x_min, x_max, y_min, y_max = self.area
            middle = np.array([x_min + x_max, y_min + y_max]) / 2
            wide = np.diag([(x_max - x_min) ** 2, (y_max - y_min) ** 2]) / 12
            return Estimate(middle, wide, lost=True, observed=False)
        offset = self.states[:, :4] - self.states[0, :4]
        joint = np.einsum("t,tij->ij", self.weights, self.covariances[:, :4, :4])
        joint = joint + np.einsum("t,ti,tj->ij", self.weights, offset, offset)
        unfamiliar = max(1.0, min(self._strange, STRANGE) / FAMILIAR)
        grown = self.measurement.lasting_growth(self.states[:1, :2]) * unfamiliar**4
        joint[:2, :2] += (grown - 1) * self._rest[6:8, 6:8]
        elsewhere = np.hypot(offset[:, 0], offset[:, 1]) > 2 * APART * self.measurement.cell
        doubted = self.weights[elsewhere].sum() > DOUBT
        lost = bool(doubted or self._missed >= 3 or self._strange > STRANGE)
        position, velocity = self.states[0, :2].copy(), self.states[0, 2:4].copy()
        told = Measurement(position, joint[:2, :2], self._independent_s)
        return Estimate(
            position, joint[:2, :2], lost=lost, measurement=told, velocity=velocity, joint=joint,
            contradicted=self._off,
        )  # fmt: skip
