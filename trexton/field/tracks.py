"""Multi-hypothesis filter over a likelihood on a grid: each hypothesis a Kalman filter with any
`LinearMotion`, updated by assumed density filtering.

A hypothesis predicts a Gaussian; times the likelihood over the cells it gives a posterior, whose
mean and covariance go back into it (assumed density filtering; Maybeck, "Stochastic Models,
Estimation and Control", vol. 2, 1982, Sec. 12.7). Its weight is the evidence of its predictions;
where a frame supports another place a hypothesis is born there. With velocity aiding, one that no
frame supports is kept for a while by dead reckoning, since places that look alike mislead.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from trexton.base.options import option
from trexton.field.field import Field
from trexton.field.hypotheses import CLUTTER_PROBABILITY, Hypotheses
from trexton.field.likelihood import peaks
from trexton.field.linear_motion import LinearMotion
from trexton.field.recent import RecentFrames
from trexton.flights.aiding import Aiding
from trexton.localization.base import Area
from trexton.localization.estimate import Estimate, Measurement, nowhere
from trexton.localization.filters import Filter
from trexton.localization.observation import Observation
from trexton.localization.texton_map import TextonMap

OUTLIER_TIME_S = 0.2  # correlation time of outliers, with velocity aiding
SEEN_SIGMA = 0.25  # m/s along an axis, of the velocity that frames show
SEEN_GATE_SIGMA = 2.0  # from it, beyond which a velocity that is given is not used
BIRTH_PROBABILITY = 1e-3  # a frame, that the vehicle is where no hypothesis is
LOG_LIKELIHOOD_RANGE = 25.0  # cells this far below the best count as none
LOST_PROBABILITY = 0.05  # of being elsewhere, from which the vehicle is lost
LOST_FRAMES = 3  # that support no hypothesis, after which it is lost
# Average normalized residual from which on it is lost: of whole images at their best place, of
# tiles, which tell more, at the estimate.
NOVELTY_THRESHOLD, TILE_NOVELTY_THRESHOLD = 2.5, 1.4
HELD_WEIGHT = 0.01  # of the best hypothesis, down to which another takes not its place
AMBIGUOUS_PROBABILITY = 0.1  # of being elsewhere by the latest frames together, likewise
CONFIRMED_S = 1.0  # for which tiles must support a track until it is taken for the vehicle's
INFLATION_RESIDUAL = 0.8  # normalized residual from which the correlated error is inflated
TEMPERING = 4.0  # power of a normalized residual above 1 that flattens the likelihood of tiles
RESIDUAL_TIME_S = 1.0  # time constant of the average normalized residual
RESIDUAL_LIMIT = 4.0  # times the threshold, what a single frame counts for at most


@dataclass(eq=False)
class Tracks(Filter):
    """The filter of method ``field``."""

    needs = {"motion": LinearMotion, "measurement": Field}
    uses = ("odometry",)
    knows_velocity: ClassVar[bool] = True
    tracks: int = option(
        5,
        "hypotheses at most, and as many again that take the velocity to be biased",
        low=1,
        high=100,
    )
    velocity_sigma: float = option(
        0.1, "standard deviation in m/s along an axis of a velocity that brings none", above=0
    )

    def open(
        self, parts: Mapping[str, Any], texton_map: TextonMap, rng: np.random.Generator
    ) -> TrackFilter:
        return TrackFilter(parts["motion"], parts["measurement"], texton_map.area, self)


class TrackFilter:
    """`Tracks` in flight, over an area in metres."""

    def __init__(
        self, motion: LinearMotion, measurement: Field, area: Area, options: Tracks | None = None
    ):
        self.measurement, self.area, self.options = measurement, area, options or Tracks()
        errors, cell = measurement.error_model, measurement.cell
        self.hypotheses = Hypotheses(motion, errors, self.options.tracks, cell)
        self._period_s = float(motion.period_s)
        self._white = errors.white_sigma**2 * np.eye(2)
        self._rounding = cell**2 / 12 * np.eye(2)  # a cell is a square, not a point
        self._residual_gain = 1 - np.exp(-self._period_s / RESIDUAL_TIME_S)
        self._tiles = len(measurement.offsets) > 1
        self._novelty = TILE_NOVELTY_THRESHOLD if self._tiles else NOVELTY_THRESHOLD
        self._confirming_s = CONFIRMED_S if self._tiles else 0.0
        self._independent: dict[float | None, float] = {}  # seconds, by the velocity's deviation
        x_min, x_max, y_min, y_max = area
        self._log_area = np.log((x_max - x_min) * (y_max - y_min))
        self._recent = RecentFrames(measurement)
        self.reset()

    def reset(self) -> None:
        """Forget where the vehicle was."""
        self.hypotheses.clear()
        self._recent.reset()
        self._since_s = self._period_s  # of the last step
        self._since_frame_s = 0.0
        self._remembers = False  # what frames said together, once it is known how they moved
        self._unsupported = 0  # frames on end that did not support the best hypothesis
        self._supported_s = 0.0  # for which frames did, since it was last in doubt
        self._residual = 0.5  # average of the latest frames, see `Field.normalized_residual`
        self._bias: np.ndarray | None = None  # m/s
        self._sigma: float | None = None  # m/s, of the last velocity

    def step(self, observation: Observation | None) -> None:
        """Advance one frame; None where nothing was observed: predict only."""
        self._bias = None
        seconds = None if observation is None else observation.since_s
        self._since_s = self._period_s if seconds is None else seconds
        self._since_frame_s += self._since_s
        if observation is not None:
            self._update(observation, seconds)
            self._since_frame_s = 0.0
            return
        self.hypotheses.predict()
        if self._remembers:
            self._recent.move(self._moved)

    def _update(self, observation: Observation, seconds: float | None) -> None:
        """Predict to a frame, then take what it shows."""
        hypotheses, best = self.hypotheses, self.hypotheses.states[:1]
        by_frame = log_posterior = self.measurement.log_posterior(observation)
        before = best[:, :2] + self._since_s * best[:, 2:4]  # where the best expects the vehicle
        if not observation.familiar:
            log_posterior = np.zeros_like(log_posterior)
        elif self._tiles:  # tiles that show a rug, say, place it nowhere
            residual = self.measurement.normalized_residual(observation, log_posterior)
            log_posterior = log_posterior / max(1.0, residual) ** TEMPERING
        peak = log_posterior.max()
        kept = np.flatnonzero(log_posterior > peak - LOG_LIKELIHOOD_RANGE)
        cells, shares = self.measurement.centers[kept], np.exp(log_posterior[kept] - peak)
        shares /= shares.sum()
        given = observation.aiding.velocity
        velocity, sigma, seen = self._believed(observation.aiding, observation.velocity_seen)
        self._sigma = None if velocity is None else float(f"{sigma:.2g}")
        if velocity is not None:
            hypotheses.switch_bias()
        hypotheses.predict(seconds)
        if velocity is not None and (velocity is given or given is None):
            hypotheses.update_velocity(velocity, sigma**2 * np.eye(2))
        if velocity is not None and seen is not None:
            self._remembers = self._tiles
            if given is not None:
                hypotheses.update_velocity(seen, SEEN_SIGMA**2 * np.eye(2), biased=False)
        if self._remembers:
            self._recent.move(self._moved)
            if observation.familiar:
                self._recent.add(log_posterior, self._since_frame_s)
        birth = np.log(BIRTH_PROBABILITY) if len(hypotheses) else 0.0
        evidence, supported = self._update_frame(cells, shares)
        log_weights = np.log(hypotheses.weights) + self._log_chance(evidence, velocity is not None)
        masses = []
        if self._remembers:
            cells, shares = self.measurement.centers, self._recent.shares
        for mean, covariance, mass in peaks(cells, shares, 2 * hypotheses.radius):
            covariance = covariance + self._rounding + self._white
            far = np.hypot(*(supported - mean).T) >= hypotheses.radius
            if far.all():
                hypotheses.give_birth(mean, covariance)
                masses.append(mass)
                supported = np.vstack([supported, mean])
        log_weights = np.concatenate([log_weights, np.log(masses) + birth])
        if not len(log_weights):  # the frame supports no place, nor did one before
            return
        if self._remembers:
            log_weights = self._recent.weighed(log_weights, supported, hypotheses.radius)
        if hypotheses.prune(log_weights, HELD_WEIGHT if self._remembers else 1.0) != 0:
            self._unsupported = 0
        self._judge(observation, by_frame, before)
        if given is not None and velocity is not given:
            self._bias = given - hypotheses.states[0, 2:4]
        elif velocity is not None and hypotheses.biased[0]:
            self._bias = hypotheses.states[0, -2:].copy()

    def _believed(
        self, given: Aiding, seen: np.ndarray | None
    ) -> tuple[np.ndarray | None, float, np.ndarray | None]:
        """The velocity that holds, its deviation, and the one that frames show: of these two the
        latter where they contradict each other, for a compass may be wrong.
        """
        sigma, usual = given.velocity_sigma or self.options.velocity_sigma, self.hypotheses.usual
        velocity, seen = usual(given.velocity, sigma), usual(seen, SEEN_SIGMA)
        if velocity is not None and seen is not None:
            if np.abs(velocity - seen).max() > SEEN_GATE_SIGMA * np.hypot(sigma, SEEN_SIGMA):
                velocity = None
        return (seen, SEEN_SIGMA, seen) if velocity is None else (velocity, sigma, seen)

    @property
    def _moved(self) -> np.ndarray:
        """``(2,)`` metres in the last step, as the best hypothesis has it."""
        return self._since_s * self.hypotheses.states[:1, 2:4].sum(axis=0)

    def _judge(
        self, observation: Observation, log_posterior: np.ndarray, before: np.ndarray
    ) -> None:
        """How well the frame fits at the estimate, and for how long frames have supported it."""
        if not observation.familiar:
            self._supported_s = 0.0
            return
        best = self.hypotheses.states[0, :2]
        near = np.hypot(*(self.measurement.centers - best).T) < self.hypotheses.radius
        if self._tiles and near.any():
            log_posterior = np.where(near, log_posterior, -np.inf)
        residual = self.measurement.normalized_residual(observation, log_posterior)
        residual = min(residual, RESIDUAL_LIMIT * self._novelty)
        self._residual += (residual - self._residual) * self._residual_gain
        jumped = (np.hypot(*(best - before).T) > 2 * self.hypotheses.radius).all()
        doubtful = jumped or self._doubtful()
        self._supported_s = 0.0 if doubtful else self._supported_s + self._since_frame_s

    def _doubtful(self) -> bool:
        """Whether other hypotheses may be right, or the frames are unlike the survey there."""
        states, weights = self.hypotheses.states, self.hypotheses.weights
        elsewhere = np.hypot(*(states[:, :2] - states[0, :2]).T) > 2 * self.hypotheses.radius
        if self._remembers:
            (here,) = self._recent.near(states[:1, :2], self.hypotheses.radius)
            if 1 - here > AMBIGUOUS_PROBABILITY:
                return True
        return bool(
            weights[elsewhere].sum() > LOST_PROBABILITY
            or self._unsupported >= LOST_FRAMES
            or self._residual > self._novelty
        )

    def _update_frame(self, cells: np.ndarray, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Update by the frame's likelihood `shares` ``(M,)`` over `cells` ``(M, 2)``; its ``(T,)``
        evidence for each hypothesis, against a place drawn from the whole area, and the ``(T, 2)``
        places where they take it to have been taken.
        """
        hypotheses = self.hypotheses
        if not len(hypotheses):
            return np.empty(0), np.empty((0, 2))
        expected, spread, precision, gain = hypotheses.innovation(hypotheses.frame, self._white)
        offset = cells - expected[:, None]
        squared = np.einsum("tmi,tmi->tm", offset @ precision, offset)
        joint = shares * np.exp(-0.5 * squared)
        mass = joint.sum(axis=1)
        norm = self._log_area - np.log(2 * np.pi) + 0.5 * np.log(np.linalg.det(precision))
        evidence = mass * np.exp(norm)
        hit = evidence > CLUTTER_PROBABILITY
        self._unsupported = 0 if hit[0] else self._unsupported + 1
        joint /= np.where(mass > 0, mass, 1)[:, None]
        mean = np.where(hit[:, None], joint @ cells, expected)
        offset = cells - mean[:, None]
        posterior = (offset * joint[..., None]).transpose(0, 2, 1) @ offset + self._rounding
        posterior = np.where(hit[:, None, None], posterior, spread)
        hypotheses.update(mean - expected, gain, spread - posterior)
        return evidence, mean

    def _log_chance(self, evidence: np.ndarray, aided: bool) -> np.ndarray:
        """``(T,)`` log probability of the frame given each hypothesis.

        An outlier supports the place that the last one supported, and takes nothing from another's.
        Without a velocity outliers are independent.
        """
        hypotheses = self.hypotheses
        if not aided:
            hypotheses.outliers = np.zeros(len(evidence))
            return np.log(evidence + CLUTTER_PROBABILITY)
        stays = np.exp(-self._since_s / OUTLIER_TIME_S)
        outlier = CLUTTER_PROBABILITY + (stays - CLUTTER_PROBABILITY) * hypotheses.outliers
        as_outlier = outlier * max(1.0, float(evidence.max(initial=0.0)))
        total = (1 - outlier) * evidence + as_outlier
        hypotheses.outliers = as_outlier / total
        return np.log(total)

    def estimate(self) -> Estimate:
        """Position of the best hypothesis, and the covariance of all about it, inflated where the
        field knows less than where its errors were learned, and while frames are unlike the survey.

        It is lost while hypotheses elsewhere may be right, no frame supports the best, or the
        frames look like no place of the survey.
        """
        hypotheses = self.hypotheses
        if not len(hypotheses):
            return nowhere(self.area)
        states, weights = hypotheses.states[:, :4], hypotheses.weights
        offset = states - states[0]
        joint = np.einsum("t,tij->ij", weights, hypotheses.covariances[:, :4, :4])
        joint = joint + np.einsum("t,ti,tj->ij", weights, offset, offset)
        unfamiliar = max(1.0, min(self._residual, NOVELTY_THRESHOLD) / INFLATION_RESIDUAL)
        inflation = self.measurement.correlated_inflation(states[:1, :2]) * unfamiliar**4
        joint[:2, :2] += (inflation - 1) * hypotheses.error_variance
        lost = self._doubtful() or self._supported_s < self._confirming_s
        if (sigma := self._sigma) not in self._independent:
            self._independent[sigma] = hypotheses.independent_s(self._white, sigma)
        position, velocity = states[0, :2].copy(), states[0, 2:].copy()
        return Estimate(
            position,
            joint[:2, :2],
            lost=lost,
            measurement=Measurement(position, joint[:2, :2], self._independent[sigma]),
            velocity=velocity,
            joint=joint,
            velocity_bias=self._bias,
        )
