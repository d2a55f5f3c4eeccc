"""A posterior covariance should hold as often as it says. Offers calibrations that learn by
cross-validation how far it must be scaled."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from trexton.base.defaults import SAMPLES
from trexton.base.errors import ParameterError
from trexton.base.options import option
from trexton.localization.base import Part, learned
from trexton.localization.distances import Distance
from trexton.localization.estimate import Estimate, Measurement
from trexton.localization.measurement import RankMixture
from trexton.localization.neighbors import Neighbors
from trexton.localization.observation import Observation
from trexton.localization.scale import ErrorScale, independent_after
from trexton.localization.training_set import Training

__all__ = ["Calibration", "Evidence", "Judge", "NoCalibration", "Replay"]

_CM = 0.01  # metres: regularizes logarithms of lengths


class Judge:
    """What calibration and integrity are in flight; this one passes the filter's own word on."""

    def reset(self) -> None:
        """Forget what was seen."""

    def judge(self, estimate: Estimate, observation: Observation | None) -> Estimate:
        """The estimate with what may be claimed of it."""
        return estimate


@dataclass(eq=False)
class Calibration(Part):
    """Base of all calibrations."""

    def open(self) -> Judge:
        """A judge for one flight."""
        return Judge()


@dataclass(eq=False)
class NoCalibration(Calibration):
    """The filter's own word is passed on (the paper's)."""


@dataclass(eq=False)
class Replay(Calibration):
    """Flies the training flight again as if it were new, and learns how large errors are.

    The covariance about the position comes to depend on the filter's own, on how far it is from
    its neighbours' mean, on their scatter, and on how unlike the frame is to all it knows. What a
    single frame measures, its neighbours' mean, gets a covariance of its own, learned from the
    frames as the measurement model learns, and the time after which its errors are as good as
    independent.
    """

    needs = {"measurement": RankMixture, "distance": Distance}
    samples: int = option(SAMPLES, "patches a frame that flight is expected to draw", low=1)
    trusting: bool = option(
        False, "leave the filter's own covariance as it is: only single frames are calibrated"
    )
    of_estimate: np.ndarray = learned()  # empty where the filter's own word is trusted
    of_measurement: np.ndarray = learned()
    independent_s: np.ndarray = learned()
    usual: np.ndarray = learned()  # () metres: the median claim along an axis in training

    def fit(self, training: Training) -> Self:
        single = SingleFrames.of(training, self.samples)
        measurement = ErrorScale.fit(single.features, single.errors, single.claimed)
        frames = independent_after(single.white(measurement), single.runs)
        learned = {
            "of_estimate": np.empty(0),
            "of_measurement": measurement.to_array(),
            "independent_s": np.asarray(frames * training.period_s),
        }
        deviations = measurement.deviation(single.features)
        if not self.trusting:
            scale, deviations = self._of_estimate(training)
            learned["of_estimate"] = scale.to_array()
        return self.with_learned(**learned, usual=np.asarray(np.median(deviations)))

    def _of_estimate(self, training: Training) -> tuple[ErrorScale, np.ndarray]:
        assert training.fly is not None  # as it is for whatever judges a method
        flown = list(training.fly(self.samples))
        seen = [Evidence.of(each.estimate, each.neighbors) for each in flown]
        features = np.array([each.about_estimate for each in seen])
        errors = np.array([each.error for each in flown])
        claimed = np.array([each.estimate.about_position for each in flown])
        scale = ErrorScale.fit(features, errors, claimed)
        return scale, scale.deviation(features)

    def prepare(self) -> None:
        if not (self.independent_s.shape == () and 0 <= self.independent_s < np.inf):
            raise ParameterError(f"errors last {self.independent_s} s: expected 0 or more")
        if not (self.usual.shape == () and 0 < self.usual < np.inf):
            raise ParameterError(f"the usual claim is {self.usual} m: expected a positive length")
        trusting = not self.of_estimate.size
        self._estimate = None if trusting else ErrorScale.from_array(self.of_estimate)
        self._measurement = ErrorScale.from_array(self.of_measurement)

    def open(self) -> Judge:
        return _Calibrated(self._estimate, self._measurement, float(self.independent_s))


@dataclass(frozen=True, eq=False, slots=True)
class Evidence:
    """What is known of a frame's errors without the truth.

    Attributes
    ----------
    measured : Measurement
        Of the frame alone.
    about_estimate : (4,) array
    about_measurement : (3,) array
        Features for `ErrorScale`.
    """

    measured: Measurement
    about_estimate: np.ndarray
    about_measurement: np.ndarray

    @classmethod
    def of(cls, estimate: Estimate, neighbors: Neighbors) -> Evidence:
        """From an estimate with its own word, and the frame's neighbours."""
        mean = neighbors.position.mean(axis=0)
        offset = neighbors.position - mean
        # So few show no shape, only a size.
        scatter = (np.square(offset).sum() / (2 * len(offset)) + _CM**2) * np.eye(2)
        measured = Measurement(mean, scatter)
        scattered, unlike = _log_size(scatter), float(np.log(neighbors.distance[0] + 1e-3))
        off = float(np.log(np.hypot(*(measured.position - estimate.position)) + _CM))
        return cls(
            measured,
            np.array([_log_size(estimate.about_position), scattered, unlike, off]),
            np.array([_log_size(measured.covariance), scattered, unlike]),
        )


@dataclass(frozen=True, eq=False)
class SingleFrames:
    """Errors of what single frames measure, and what is known of each.

    Attributes
    ----------
    errors : (N, 2) array
    features : (N, 3) array
    claimed : (N, 2, 2) array
    runs : (N,) array
        Frames that follow each other share a number.
    """

    errors: np.ndarray
    features: np.ndarray
    claimed: np.ndarray
    runs: np.ndarray

    @classmethod
    def of(cls, training: Training, samples: int) -> SingleFrames:
        """Of the neighbours' mean, those near in time left out as for the measurement model."""
        _, neighbors = training.resampled(samples)
        errors, about, claimed = [], [], []
        for row, nearest in enumerate(neighbors):
            nobody = Estimate(nearest.position.mean(axis=0), np.eye(2))
            evidence = Evidence.of(nobody, nearest)
            errors.append(evidence.measured.position - training.positions[row])
            about.append(evidence.about_measurement)
            claimed.append(evidence.measured.covariance)
        gaps = np.diff(training.time) > 1.5 * training.period_s
        runs = np.concatenate([[0], np.cumsum(gaps)])
        return cls(np.array(errors), np.array(about), np.array(claimed), runs)

    def white(self, scale: ErrorScale) -> np.ndarray:
        """``(N, 2)`` errors over the deviations that a scale gives them."""
        covariance = scale.covariance(self.features, self.claimed)
        root = np.linalg.cholesky(covariance)
        return np.linalg.solve(root, self.errors[..., None])[..., 0]


class _Calibrated(Judge):
    def __init__(self, estimate: ErrorScale | None, measurement: ErrorScale, independent_s: float):
        self._estimate, self._measurement = estimate, measurement
        self._independent_s = independent_s
        self.reset()

    def reset(self) -> None:
        """Forget how far the last frame's claim was off."""
        self._ratio = 1.0

    def judge(self, estimate: Estimate, observation: Observation | None) -> Estimate:
        claimed = estimate.about_position
        if observation is None:
            return replace(estimate, covariance=self._ratio * claimed, mean=None)
        evidence = Evidence.of(estimate, observation.neighbors)
        honest = claimed
        if self._estimate is not None:
            honest = self._estimate.covariance(evidence.about_estimate, claimed)
        self._ratio = float(np.exp(2 * (_log_size(honest) - _log_size(claimed))))
        measured = evidence.measured
        sure = self._measurement.covariance(evidence.about_measurement, measured.covariance)
        fusible = Measurement(measured.position, sure, self._independent_s)
        return replace(estimate, covariance=honest, mean=None, measurement=fusible)


def _log_size(covariance: np.ndarray) -> float:
    """Log of the geometric mean deviation in metres."""
    return 0.25 * float(np.log(max(np.linalg.det(covariance), 1e-24)))
