"""The particle filter (paper, Sec. Filtering): motion model, measurement model, resampling, point estimate, spread.

Shapes, throughout: `particles` is ``(M, 2)``, metres; `weights` is ``(M,)``, summing to one; a measurement is the
``(k, 2)`` positions of the nearest histograms, best first; covariances are ``(2, 2)``, square metres. Likelihoods
are kept as logarithms. The parts know nothing of each other: each is chosen by name or passed in.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from trexton.errors import ParameterError
from trexton.kernels import in_strips

__all__ = [
    "Belief",
    "ESTIMATORS",
    "GaussianMotion",
    "ParticleFilter",
    "RESAMPLERS",
    "RankMixture",
    "estimate_highest_weight",
    "estimate_map",
    "estimate_mean",
    "resampling_wheel",
    "systematic_resampling",
]

# Pairs of particles whose densities are held at once: they stay in the processor's cache.
_PAIRS = 2**16
_WORTH_THREADS = 64  # blocks of pairs; fewer are done before a thread has started
_MINUS_HALF = np.array([-0.5, -0.5])
# Particles further apart than this log density count as this far: denormal numbers would take ten times as long.
_FAR = -500.0
# Below this the plain weights would all be zero in double precision: no particle explains the measurement.
_VANISHED = np.log(np.finfo(float).tiny)


def _whitener(covariance: np.ndarray, what: str) -> np.ndarray:
    """The ``(2, 2)`` matrix W with ``|W d|^2 = d' covariance^-1 d``."""
    covariance = np.asarray(covariance, dtype=float)
    try:
        if covariance.shape != (2, 2) or not np.isfinite(covariance).all():
            raise np.linalg.LinAlgError
        return np.linalg.inv(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError:
        raise ParameterError(
            f"the {what} covariance is {covariance.tolist()}: expected a positive definite 2x2 matrix in square metres"
        ) from None


class GaussianMotion:
    """Motion model x_t = x_{t-1} + N(0, Sigma_process), with no velocity and no control input.

    Parameters
    ----------
    covariance : (2, 2) array
        Sigma_process, of the displacement from one frame to the next.
    """

    def __init__(self, covariance: np.ndarray):
        self._whiten = _whitener(covariance, "process")
        self._color = np.linalg.inv(self._whiten)

    def sample(self, particles: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Move every particle by its own draw of the process noise."""
        moved = rng.standard_normal(particles.shape).dot(self._color.T)
        moved += particles
        return moved

    def log_predictive(
        self, particles: np.ndarray, previous: np.ndarray, weights: np.ndarray
    ) -> np.ndarray:
        """``(M,)`` log of sum_j p(x_i | x_j at t-1) w_j, up to a constant that all particles share."""
        # -|a - b|^2 / 2 of all pairs is one product of [a, -|a|^2 / 2, 1] with [b, 1, -|b|^2 / 2].
        count = len(particles)
        both = np.concatenate((particles, previous))
        both -= previous[0]  # keeps the squares small, and so exact
        features = np.empty((len(both), 4))
        white = np.dot(both, self._whiten.T, out=both)
        features[:, :2], features[:, 2:] = white, 1
        squares = np.dot(white * white, _MINUS_HALF)
        features[:count, 2], features[count:, 3] = squares[:count], squares[count:]
        # No pair is further apart than twice the length of the longest vector.
        near = 4 * squares.min() > _FAR
        density = np.empty(count)
        rows = min(count, max(1, _PAIRS // len(previous)))
        blocks = range(0, count, rows)

        def work(part: slice) -> None:
            buffer = np.empty((rows, len(previous)))
            for first in blocks[part]:
                block = features[first : min(first + rows, count)]
                pairs = np.matmul(block, features[count:].T, out=buffer[: len(block)])
                if not near:
                    np.maximum(pairs, _FAR, out=pairs)
                np.exp(pairs, out=pairs)
                np.dot(pairs, weights, out=density[first : first + len(block)])

        if len(blocks) < _WORTH_THREADS:
            work(slice(None))
        else:
            in_strips(work, len(blocks))
        return np.log(density, out=density)


class RankMixture:
    """Measurement model: sum over neighbour ranks j of N(z_j; x, Sigma_j), Alg. 2 of the paper.

    Parameters
    ----------
    covariances : (k, 2, 2) array
        Sigma^[j] = Var(T - P_j) of each rank, best first.
    """

    def __init__(self, covariances: np.ndarray):
        covariances = np.asarray(covariances, dtype=float)
        if covariances.ndim != 3 or not len(covariances):
            raise ParameterError(
                f"rank covariances have shape {covariances.shape}: expected (k, 2, 2), one for each neighbour"
            )
        self._whiten = np.stack(
            [_whitener(covariance, f"rank {j + 1}") for j, covariance in enumerate(covariances)]
        )
        self._rows = self._whiten.reshape(-1, 2)  # whitens for all ranks at once
        self._log_norm = (np.log(np.abs(np.linalg.det(self._whiten))) - np.log(2 * np.pi))[:, None]

    @property
    def k(self) -> int:
        return len(self._whiten)

    def log_likelihood(self, particles: np.ndarray, measurement: np.ndarray) -> np.ndarray:
        """``(M,)`` log of the mixture density of `measurement` at each particle."""
        if measurement.shape != (self.k, 2):
            raise ParameterError(
                f"the measurement has shape {measurement.shape}: expected ({self.k}, 2), one position for each rank"
            )
        deviation = self._rows.dot(particles.T)
        deviation -= np.matmul(self._whiten, measurement[..., None]).reshape(-1, 1)
        deviation *= deviation
        exponent = deviation[::2] + deviation[1::2]  # (k, M)
        exponent *= -0.5
        exponent += self._log_norm
        peak = np.maximum.reduce(exponent)
        exponent -= peak
        np.exp(exponent, out=exponent)
        density = np.add.reduce(exponent)
        return np.log(density, out=density) + peak


def resampling_wheel(weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """``(M,)`` indices drawn by the resampling wheel the paper cites.

    The wheel starts at a random particle and advances by U(0, 2 max w) between draws. Walking it costs
    max w / mean w steps a particle; a search in the cumulated weights finds the same particles.
    """
    start = rng.integers(len(weights))
    ends = weights.cumsum()
    travelled = rng.random(len(weights)).cumsum() * (2 * weights.max())
    places = travelled + (ends[start] - weights[start])
    places -= np.floor(places / ends[-1]) * ends[-1]
    return np.minimum(ends.searchsorted(places, side="left"), len(weights) - 1)


def systematic_resampling(weights: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """``(M,)`` indices from one random offset and equal steps: counts differ from M w by less than one."""
    count = len(weights)
    ends = weights.cumsum()
    places = (np.arange(count) + rng.random()) / count * ends[-1]
    return np.minimum(ends.searchsorted(places, side="right"), count - 1)


@dataclass(frozen=True, eq=False, slots=True)
class Belief:
    """The filter's state after one step, before resampling.

    Attributes
    ----------
    particles : (M, 2) array
    weights : (M,) array
    log_likelihood : (M,) array
        Zero where nothing was measured.
    log_mean_likelihood : float
        Of the measurement under the whole set; NaN where nothing was measured.
    lost : bool
        No particle explained the measurement, or the measurements have stopped fitting.
    """

    particles: np.ndarray
    weights: np.ndarray
    log_likelihood: np.ndarray
    log_mean_likelihood: float = np.nan
    lost: bool = False

    @property
    def measured(self) -> bool:
        """Whether the weights come from a measurement."""
        return self.log_mean_likelihood == self.log_mean_likelihood


def estimate_map(belief: Belief, previous: Belief | None, motion: GaussianMotion) -> np.ndarray:
    """Maximum a posteriori particle: argmax of p(z_t | x_i) sum_j p(x_i | x_j at t-1) w_j at t-1 (Driessen & Boers 2008)."""
    score = belief.log_likelihood
    if previous is not None:
        score = score + motion.log_predictive(
            belief.particles, previous.particles, previous.weights
        )
    return belief.particles[np.argmax(score)]


def estimate_mean(belief: Belief, previous: Belief | None, motion: GaussianMotion) -> np.ndarray:
    """Weighted mean of the particles."""
    return belief.weights @ belief.particles


def estimate_highest_weight(
    belief: Belief, previous: Belief | None, motion: GaussianMotion
) -> np.ndarray:
    """The particle of highest weight, the first where several share it."""
    return belief.particles[np.argmax(belief.weights)]


RESAMPLERS: dict[str, Callable] = {"wheel": resampling_wheel, "systematic": systematic_resampling}
ESTIMATORS: dict[str, Callable] = {
    "map": estimate_map,
    "mean": estimate_mean,
    "highest-weight": estimate_highest_weight,
}


def chosen(table: dict[str, Callable], name: str, what: str) -> Callable:
    """The entry `name` of a table of interchangeable parts."""
    try:
        return table[name]
    except KeyError:
        raise ParameterError(
            f"{what} {name!r} is unknown: choose one of {', '.join(table)}"
        ) from None


class ParticleFilter:
    """Alg. 2 of the paper: predict, weigh, resample; and a point estimate from what it holds.

    Parameters
    ----------
    motion : GaussianMotion
    measurement : RankMixture
    area : (x_min, x_max, y_min, y_max)
        Where particles start, in metres.
    particles : int
        M, their number.
    resampling : {"wheel", "systematic"}
    estimator : {"map", "mean", "highest-weight"}
    recovery : Recovery, optional
        Replaces part of the particles when measurements stop fitting; see `trexton.recovery`.
    rng : numpy.random.Generator
    """

    def __init__(
        self,
        motion,
        measurement,
        area,
        particles=50,
        *,
        resampling="wheel",
        estimator="map",
        recovery=None,
        rng,
    ):
        if particles < 1:
            raise ParameterError(f"{particles} particles were asked for: expected at least 1")
        self.motion, self.measurement, self.area, self.size, self.rng = (
            motion,
            measurement,
            area,
            int(particles),
            rng,
        )
        self.recovery = recovery
        self._resample = chosen(RESAMPLERS, resampling, "resampling")
        self._estimate = chosen(ESTIMATORS, estimator, "estimator")
        self.reset()

    def reset(self, lost: bool = False) -> None:
        """Forget everything: particles uniform over the area."""
        weights = np.full(self.size, 1 / self.size)
        self.belief = Belief(self.uniform(self.size), weights, np.zeros(self.size), lost=lost)
        self._previous: Belief | None = None
        if self.recovery is not None:
            self.recovery.reset()

    def uniform(self, count: int) -> np.ndarray:
        """``(count, 2)`` positions drawn uniformly over the area."""
        x_min, x_max, y_min, y_max = self.area
        return self.rng.uniform((x_min, y_min), (x_max, y_max), (count, 2))

    def step(self, measurement: np.ndarray | None) -> Belief:
        """Advance one frame; `measurement` is ``(k, 2)`` metres, or None where nothing was measured: predict only."""
        previous = self.belief
        if previous.measured:
            particles = previous.particles.take(self._resample(previous.weights, self.rng), axis=0)
        else:  # equal weights need no resampling, which would only lose particles
            particles = previous.particles.copy()
        if self.recovery is not None:
            self.recovery.inject(particles, self)
        particles = self.motion.sample(particles, self.rng)
        self._previous = previous
        if measurement is None:
            weights, flat = np.full(self.size, 1 / self.size), np.zeros(self.size)
            self.belief = Belief(particles, weights, flat, lost=previous.lost)
        else:
            self.belief = self._weigh(particles, measurement)
        return self.belief

    def _weigh(self, particles: np.ndarray, measurement: np.ndarray) -> Belief:
        log_likelihood = self.measurement.log_likelihood(particles, measurement)
        peak = log_likelihood.max()
        if not peak > _VANISHED:  # also true for NaN
            self.reset(lost=True)
            return self.belief
        weights = np.exp(log_likelihood - peak)
        total = weights.sum()
        log_mean = float(peak + np.log(total / self.size))
        lost = self.recovery is not None and self.recovery.update(log_mean)
        return Belief(particles, weights / total, log_likelihood, log_mean, lost)

    def estimate(self) -> np.ndarray:
        """``(2,)`` point estimate in metres from the latest step."""
        return self._estimate(self.belief, self._previous, self.motion)

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Weighted mean ``(2,)`` and covariance ``(2, 2)`` of the particles."""
        mean = self.belief.weights @ self.belief.particles
        deviation = self.belief.particles - mean
        return mean, (deviation * self.belief.weights[:, None]).T @ deviation
