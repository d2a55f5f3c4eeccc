"""Motion models: how a state goes on from one frame to the next, and how uncertainty grows.

A state's first two columns need not be its position: `MotionModel.position` says where it is.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from trexton.base.errors import MapError, ParameterError
from trexton.base.options import option
from trexton.localization.base import Area, Part, learned
from trexton.localization.training_set import Training

# Pairs of particles whose densities are held at once: they stay in the processor's cache.
_PAIRS = 2**16
_MINUS_HALF = np.array([-0.5, -0.5])
# Particles count as at most this log density apart: denormal numbers take ten times as long.
_MIN_EXPONENT = -500.0
_SMALL = 1e-30  # of weights: smaller ones are soon denormal in single precision
# Of squares on which bounds are found: the least side, in deviations of the process, and how many
# make up a side of all, times the root of the particles.
_SQUARE, _SQUARES = 0.1, 2.5
# Pairs of particles from which bounds of their densities save time.
_WORTH_BINNED, _WORTH_SINGLE = 700**2, 300**2
_CANDIDATES = 4  # particles of the highest bounds: what they reach the others must be able to


class MotionModel(Part):
    """Base of all motion models; states are ``(M, D)`` arrays."""

    def start(self, rng: np.random.Generator, area: Area, count: int) -> np.ndarray:
        """``(count, D)`` states of a vehicle that may be anywhere in the area."""
        raise NotImplementedError

    def sample(self, states: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """The states one frame later, each by its own draw."""
        raise NotImplementedError

    def density(self, states: np.ndarray, previous: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """``(M,)`` log of sum_j p(x_i | x_j a frame before) w_j, up to a shared constant: of
        ``(M, D)`` `states` x_i, ``(N, D)`` `previous` x_j and their ``(N,)`` `weights` w_j.
        """
        raise NotImplementedError

    def likeliest(
        self, scores: np.ndarray, states: np.ndarray, previous: np.ndarray, weights: np.ndarray
    ) -> int:
        """Row of the state whose score, ``(M,)``, and `density` together are highest."""
        return int((scores + self.density(states, previous, weights)).argmax())

    def position(self, states: np.ndarray) -> np.ndarray:
        """``(M, 2)`` metres."""
        raise NotImplementedError

    def growth(self, dt: float) -> np.ndarray:
        """``(2, 2)`` square metres that `dt` seconds unseen add to a position's covariance."""
        raise NotImplementedError


@dataclass(eq=False)
class RandomWalk(MotionModel):
    """x_t = x_{t-1} + N(0, Sigma_process), with no velocity and no control input (paper, Sec.
    Filtering).

    Attributes
    ----------
    covariance : (2, 2) array
        Sigma_process, learned, square metres a frame.
    period_s : () array
        Seconds from frame to frame.
    """

    sigma: float | None = option(
        None, "standard deviation in metres a frame along an axis; learned unless given", above=0
    )
    covariance: np.ndarray = learned()
    period_s: np.ndarray = learned()

    def fit(self, training: Training) -> Self:
        if self.sigma is None:
            covariance = process_covariance(training.positions, training.time)
        else:
            covariance = np.eye(2) * self.sigma**2
        return self.with_learned(covariance=covariance, period_s=np.asarray(training.period_s))

    def prepare(self) -> None:
        if not (self.period_s.shape == () and 0 < self.period_s < np.inf):
            raise ParameterError(
                f"the motion's period is {self.period_s} s: expected a positive number"
            )
        self._whiten = whitener(self.covariance, "process")
        self._color = np.linalg.inv(self._whiten)

    def start(self, rng: np.random.Generator, area: Area, count: int) -> np.ndarray:
        return uniform_places(rng, area, count)

    def sample(self, states: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        return states + rng.standard_normal(states.shape).dot(self._color.T)

    def position(self, states: np.ndarray) -> np.ndarray:
        return states

    def growth(self, dt: float) -> np.ndarray:
        return self.covariance * (dt / float(self.period_s))

    def density(self, states: np.ndarray, previous: np.ndarray, weights: np.ndarray) -> np.ndarray:
        pairs, half = self._features(states, previous)
        # No pair is further apart than twice the length of the longest vector.
        least = None if 4 * half < -_MIN_EXPONENT else _MIN_EXPONENT
        return np.log(_summed(*pairs, weights, least))

    def _features(
        self, states: np.ndarray, previous: np.ndarray
    ) -> tuple[tuple[np.ndarray, np.ndarray], float]:
        """``(M, 4)``, ``(4, N)``: their product is -|a - b|^2 / 2, whitened; largest |a|^2 / 2."""
        count = len(states)
        white = np.concatenate((states, previous))
        white -= previous[0]  # keeps the squares small, and so exact
        white = white.dot(self._whiten.T)
        left, right = np.empty((count, 4)), np.empty((4, len(previous)))
        left[:, :2], left[:, 3] = white[:count], 1
        right[:2], right[2] = white[count:].T, 1
        white *= white
        squares = white.dot(_MINUS_HALF)
        left[:, 2], right[3] = squares[:count], squares[count:]
        return (left, right), -squares.item(squares.argmin())

    def likeliest(
        self, scores: np.ndarray, states: np.ndarray, previous: np.ndarray, weights: np.ndarray
    ) -> int:
        """See `MotionModel.likeliest`; of many states those are left out that a bound rules out."""
        if len(states) * len(previous) < _WORTH_SINGLE:
            return super().likeliest(scores, states, previous, weights)
        rows = np.arange(len(states))
        for worth, bounds in ((_WORTH_BINNED, self._binned), (_WORTH_SINGLE, self._single)):
            if len(rows) * len(previous) < worth or len(rows) <= _CANDIDATES:
                continue
            highest = scores[rows] + bounds(states[rows], previous, weights)
            best = rows[np.argpartition(highest, -_CANDIDATES)[-_CANDIDATES:]]
            reached = scores[best] + self.density(states[best], previous, weights)
            rows = rows[highest >= reached.max()]
        return int(rows[super().likeliest(scores[rows], states[rows], previous, weights)])

    def _binned(self, states: np.ndarray, previous: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """``(M,)`` upper bounds of `density` of particles that are put on squares.

        A density is at most what it were if all of each square stood as near as squares allow,
        which is a sum along x of sums along y.
        """
        places = np.concatenate((states, previous)) @ self._whiten.T
        places -= places.min(axis=0)
        side = max(_SQUARE, places.max() / (_SQUARES * np.sqrt(len(states))))
        squares = (places / side).astype(np.int64)
        shape = squares.max(axis=0) + 1
        numbers = squares[:, 0] * shape[1] + squares[:, 1]
        masses = np.bincount(numbers[len(states) :], weights, int(shape.prod())).reshape(shape)
        for axis, count in enumerate(shape):
            apart = np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
            nearest = np.exp(-0.5 * (side * np.maximum(np.arange(count) - 1, 0)) ** 2)[apart]
            masses = nearest @ masses if axis == 0 else masses @ nearest
        bounds = np.log(masses + np.exp(_MIN_EXPONENT)).ravel()[numbers[: len(states)]]
        return bounds + 1e-9  # sums are rounded

    def _single(self, states: np.ndarray, previous: np.ndarray, weights: np.ndarray) -> np.ndarray:
        """``(M,)`` upper bounds of `density`: sums in single precision, and all they may lack."""
        (left, right), half = self._features(states, previous)
        shares = weights * (weights >= _SMALL)
        left, right, shares = (each.astype(np.float32) for each in (left, right, shares))
        sums = _summed(left, right, shares, None) + len(previous) * _SMALL
        return np.log(sums, dtype=float) + 2.0**-22 * (8 * half + len(previous) + 16)


def _summed(
    left: np.ndarray, right: np.ndarray, weights: np.ndarray, least: float | None
) -> np.ndarray:
    """``(M,)`` exp(left right) weights, exponents raised to `least`, a block of pairs at a time."""
    rows = max(1, _PAIRS // len(weights))
    if len(left) > rows:
        blocks = np.split(left, range(rows, len(left), rows))
        return np.concatenate([_summed(block, right, weights, least) for block in blocks])
    pairs = left.dot(right)
    if least is not None:
        np.maximum(pairs, least, out=pairs)
    np.exp(pairs, out=pairs)
    return pairs.dot(weights)


def process_covariance(positions: np.ndarray, time: np.ndarray) -> np.ndarray:
    """``(2, 2)`` Sigma_process, the covariance of the forward differences T_t - T_{t-1} (Sec.
    Filtering).

    Pairs with a gap of more than one and a half periods between them say nothing about one step and
    are left out. Raises `MapError` where fewer than two are left.
    """
    gaps = np.diff(time)
    steps = np.diff(positions, axis=0)[gaps <= 1.5 * np.median(gaps)]
    if len(steps) < 2:
        raise MapError(
            f"{len(positions)} training frames make {len(steps)} steps from frame to frame: "
            "the motion model needs at least 2, record a longer flight"
        )
    return np.cov(steps.T) + 1e-8 * np.eye(2)


def uniform_places(rng: np.random.Generator, area: Area, count: int) -> np.ndarray:
    """``(count, 2)`` positions drawn uniformly over the area."""
    x_min, x_max, y_min, y_max = area
    return rng.uniform((x_min, y_min), (x_max, y_max), (count, 2))


def whitener(covariance: np.ndarray, what: str) -> np.ndarray:
    """The ``(2, 2)`` matrix W with ``|W d|^2 = d' covariance^-1 d``.

    Raises
    ------
    ParameterError
        The covariance is not positive definite.
    """
    covariance = np.asarray(covariance, dtype=float)
    try:
        if covariance.shape != (2, 2) or not np.isfinite(covariance).all():
            raise np.linalg.LinAlgError
        return np.linalg.inv(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError:
        raise ParameterError(
            f"the {what} covariance is {covariance.tolist()}: "
            "expected a positive definite 2x2 matrix in square metres"
        ) from None
