"""A hidden Markov model whose states are the training frames: the simplest filter that knows a map.

It offers `HiddenMarkov`, the forward filter with the distance between histograms as emission. It is
a baseline for other methods, and fits any features (Rabiner, "A tutorial on hidden Markov models",
Proc. IEEE 77, 1989, Sec. III.A).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from trexton.base.defaults import SAMPLES
from trexton.localization.base import learned
from trexton.localization.estimate import CHI2_90, Estimate
from trexton.localization.filters import Filter
from trexton.localization.motion import MotionModel
from trexton.localization.neighbors import Distance, neighbors_in_flight
from trexton.localization.observation import Observation
from trexton.localization.texton_map import TextonMap
from trexton.localization.training_set import EXCLUDED_SECONDS, Training

MAX_STATES = 1200  # of longer flights every n-th frame is a state
FOLDS = 5  # stretches of the training flight that are left out to choose the settings
SCALES = (0.2, 0.35, 0.6, 1.0, 1.6)  # of the emission, over the median distance of neighbours
REACHES = (1.0, 2.0, 4.0)  # of the transition, over the root mean square step of a frame
TELEPORT = 1e-3  # probability a frame of a jump to any state
MIN_SIGMA = 0.01  # metres, of what is claimed
TINY = 1e-30  # least weight of a state: smaller numbers would take longer


@dataclass(eq=False)
class HiddenMarkov(Filter):
    """The filter of method ``hmm``; its settings have the least error over left-out stretches."""

    needs = {"motion": MotionModel, "distance": Distance}
    emission: np.ndarray = learned()  # () standard deviation of a distance between histograms
    reach: np.ndarray = learned()  # () metres a frame, of the transition
    sigma: np.ndarray = learned()  # () metres that the spread lacks, so that 90 % regions hold 90 %

    def fit(self, training: Training) -> Self:
        places, time = training.positions, training.time
        regular = np.diff(time) < 1.5 * training.period_s
        steps = np.square(np.diff(places, axis=0)[regular]).sum(axis=1)
        usual = np.sqrt(steps.mean()) if len(steps) else 0.0
        drawn, distance = training.drawn(SAMPLES), training.distance
        rows = neighbors_in_flight(training.nearest, drawn, time, 1, EXCLUDED_SECONDS)
        pairs = zip(drawn, training.histograms[rows], strict=True)
        typical = np.median([distance.between(each[None], near).item() for each, near in pairs])
        scales = max(float(typical), 1e-9) * np.array(SCALES)
        choices = []
        for reach in max(float(usual), MIN_SIGMA) * np.array(REACHES):
            off, spread = _left_out(training, drawn, scales, float(reach))
            for number, emission in enumerate(scales):
                error = np.hypot(*off[:, number].T).mean()
                choices.append((error, emission, reach, off[:, number], spread[:, number]))
        _, emission, reach, off, spread = min(choices, key=lambda each: each[0])
        return self.with_learned(emission=emission, reach=reach, sigma=_lacking(off, spread))

    def open(
        self, parts: Mapping[str, Any], texton_map: TextonMap, rng: np.random.Generator
    ) -> ForwardFilter:
        chosen = slice(None, None, -(-len(texton_map.positions) // MAX_STATES))
        places, rows = texton_map.positions[chosen], texton_map.histograms[chosen]
        return ForwardFilter(places, rows, parts["distance"], self)


def _left_out(
    training: Training, drawn: np.ndarray, scales: np.ndarray, reach: float
) -> tuple[np.ndarray, np.ndarray]:
    """Errors ``(N, S, 2)`` in metres of left-out frames, seen as `drawn` ``(N, K)``, under each
    scale of the emission, and the covariances ``(N, S, 2, 2)`` of their beliefs.
    """
    chosen = slice(None, None, -(-len(training.positions) // MAX_STATES))
    places = training.positions[chosen] - training.positions.mean(axis=0)
    rows = training.histograms[chosen]
    time, count = training.time[chosen], len(scales)
    off, spread = np.empty((len(places), count, 2)), np.empty((len(places), count, 2, 2))
    for fold in np.array_split(np.arange(len(places)), FOLDS):
        first, last = time[fold[0]] - EXCLUDED_SECONDS, time[fold[-1]] + EXCLUDED_SECONDS
        states = places[kept := (time < first) | (time > last)]
        transition = _transition(states, reach)
        products = (states[:, :, None] * states[:, None]).reshape(-1, 4)
        energy = -0.5 * np.square(training.distance.between(drawn[chosen][fold], rows[kept]))
        belief = np.full((len(states), count), 1 / len(states))
        for row, each in zip(fold, energy, strict=True):
            belief = _updated(transition @ belief, each[:, None] / scales**2)
            mean = belief.T @ states
            second = (belief.T @ products).reshape(-1, 2, 2)
            spread[row] = second - mean[:, :, None] * mean[:, None]
            off[row] = mean - places[row]
    return off, spread


def _lacking(off: np.ndarray, spread: np.ndarray) -> float:
    """Metres along an axis: added to the spread ``(N, 2, 2)``, nine in ten errors ``(N, 2)`` lie in
    their 90 % regions.
    """
    sigma = MIN_SIGMA
    while True:
        precision = np.linalg.inv(spread + sigma**2 * np.eye(2))
        squared = np.einsum("ni,nij,nj->n", off, precision, off)
        if np.quantile(squared, 0.9) <= CHI2_90:
            return sigma
        sigma *= 1.1


def _transition(places: np.ndarray, reach: float) -> np.ndarray:
    """``(N, N)`` probability of each state after each other one, which stand in columns."""
    apart = np.square(places[:, None] - places).sum(axis=2)
    walk = np.exp(-0.5 * apart / reach**2)
    return (1 - TELEPORT) * walk / walk.sum(axis=0) + TELEPORT / len(places)


def _updated(belief: np.ndarray, log_likelihood: np.ndarray) -> np.ndarray:
    """The belief ``(N, ...)`` after a measurement, summing to one over the states."""
    belief = belief * np.exp(log_likelihood - log_likelihood.max(axis=0)) + TINY
    return belief / belief.sum(axis=0)


class ForwardFilter:
    """`HiddenMarkov` in flight: states at `places` ``(N, 2)`` with histograms `rows` ``(N, K)``.

    Attributes
    ----------
    belief : (N,) array
        Probability of each state.
    """

    def __init__(
        self, places: np.ndarray, rows: np.ndarray, distance: Distance, learned: HiddenMarkov
    ):
        self._places, self._distance, self._learned = places, distance, learned
        self._rows = distance.features(rows) if distance.embedded else rows
        self._transition = _transition(places, float(learned.reach))
        self.reset()

    def reset(self) -> None:
        """Forget where the vehicle was."""
        self.belief = np.full(len(self._places), 1 / len(self._places))

    def step(self, observation: Observation | None) -> None:
        """Advance one frame; None where nothing was observed: predict only."""
        self.belief = self._transition @ self.belief
        if observation is not None:
            histogram = observation.histogram
            if self._distance.embedded:
                offset = self._rows - self._distance.features(histogram)
                squared = np.einsum("nk,nk->n", offset, offset)
            else:
                squared = np.square(self._distance.between(histogram[None], self._rows)[0])
            log_likelihood = -0.5 * squared / float(self._learned.emission) ** 2
            self.belief = _updated(self.belief, log_likelihood)

    def estimate(self) -> Estimate:
        """Mean and covariance of the belief, the latter widened as left-out stretches asked."""
        mean = self.belief @ self._places
        offset = self._places - mean
        spread = (offset.T * self.belief) @ offset
        return Estimate(mean, spread + float(self._learned.sigma) ** 2 * np.eye(2))
