"""Lost or not: a test of its own, whatever the filter thinks of itself.

If the vehicle is where the estimate says, then what single frames measure scatters about it as
much as it did about the true positions of the training flight. A mean over the last frames that
is larger than all but a stated share of what training showed says that the vehicle is lost.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from trexton.errors import MapError, ParameterError
from trexton.estimate import Estimate
from trexton.observation import Observation
from trexton.parts.base import Part, Training, learned
from trexton.parts.calibration import Judge, Passing, Replay

__all__ = ["Innovation", "Integrity", "NoIntegrity"]

_MOST = 9.0  # squared deviations that one frame may add: a single odd one is no proof


@dataclass(eq=False)
class Integrity(Part):
    """Base of all integrity tests."""

    def open(self) -> Judge:
        """A judge for one flight."""
        raise NotImplementedError


@dataclass(eq=False)
class NoIntegrity(Integrity):
    """The filter's own word is passed on (the paper's filter never says that it is lost)."""

    def open(self) -> Judge:
        return Passing()


@dataclass(eq=False)
class Innovation(Integrity):
    """Mean squared innovation of the last frames, in units of what may honestly be claimed.

    Parameters
    ----------
    memory_s : float
        Time in seconds over which frames are averaged.
    false_alarms : float
        Share of right frames that may be called lost.
    """

    memory_s: float = 0.25
    false_alarms: float = 0.002
    threshold: np.ndarray = learned()
    period_s: np.ndarray = learned()

    def check(self) -> None:
        if not 0 < self.memory_s < np.inf:
            raise ParameterError(f"memory_s is {self.memory_s}: expected a positive time")
        if not 0 < self.false_alarms < 1:
            raise ParameterError(
                f"false_alarms is {self.false_alarms}: expected a share between 0 and 1"
            )

    def fit(self, training: Training) -> Self:
        """Learn the threshold.

        Raises
        ------
        MapError
            There is no calibration, whose claims are what this tests.
        """
        whole = training.texton_map
        calibration = whole.parts.get("calibration") if whole is not None else None
        if not isinstance(calibration, Replay):
            raise MapError(
                "integrity tests what a calibration claims: train it with calibration=replay"
            )
        squared, runs = calibration.innovations(training)
        rate = self._rate(training.period_s)
        means, run = [], -1
        for value, number in zip(squared, runs, strict=True):
            if number != run:
                run, mean = number, _Mean(rate)
            means.append(mean.add(value))
        return self.with_learned(
            # Below what one frame may add, or nothing would ever be found.
            threshold=np.asarray(min(np.quantile(means, 1 - self.false_alarms), 0.9 * _MOST)),
            period_s=np.asarray(training.period_s),
        )

    def prepare(self) -> None:
        for name, value in self.arrays().items():
            if not (value.shape == () and 0 < value < np.inf):
                raise ParameterError(
                    f"the integrity's {name} is {value}: expected a positive number"
                )

    def _rate(self, period_s: float) -> float:
        return float(-np.expm1(-period_s / self.memory_s))

    def open(self) -> Judge:
        return _Watch(float(self.threshold), self._rate(float(self.period_s)))


class _Mean:
    """Exponential mean; a plain one until enough was seen."""

    def __init__(self, rate: float):
        self.rate, self.value, self.count = rate, 0.0, 0

    def add(self, squared: float) -> float:
        self.count += 1
        step = min(squared, _MOST) - self.value
        self.value += max(self.rate, 1 / self.count) * step
        return self.value


class _Watch:
    def __init__(self, threshold: float, rate: float):
        self._threshold, self._rate = threshold, rate
        self.reset()

    def reset(self) -> None:
        """Forget all frames; lost until enough were seen."""
        self._mean, self._lost = _Mean(self._rate), True

    def judge(self, estimate: Estimate, observation: Observation | None) -> Estimate:
        measured = estimate.measurement
        if observation is not None and measured is not None:
            off = measured.position - estimate.position
            expected = measured.covariance + estimate.covariance
            mean = self._mean.add(float(off @ np.linalg.solve(expected, off)))
            self._lost = mean > self._threshold or self._mean.count * self._rate < 1
        return replace(estimate, lost=self._lost)
