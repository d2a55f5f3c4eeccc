"""A frame's features are more or less likely at each cell of a floor. Offers the cells, tables of
that likelihood for whole images and for tiles, its peaks, the prior, and a model of the errors.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from trexton.localization.base import Area

DEGREES_OF_FREEDOM = 6.0  # of the Student distribution
CLUTTER_SHARE = 0.02  # of tiles, that show what the survey did not
# Of the prior that does not expect the vehicle where the survey was: of histograms of a floor, and
# of other senses, such as radio, which change slowly over the area.
UNIFORM_SHARE, WIDE_UNIFORM_SHARE = 0.1, 0.5
MIN_EXPLAINED = 0.02  # share of the signal that the field explains of any place
COUNTED_RESIDUAL = 1.1  # squared, of familiar frames in which counting is all the noise
PEAKS, PEAK_MASS = 2, 0.02  # at most; and the share of a likelihood that one must hold


@dataclass(frozen=True, eq=False)
class Basis:
    """Axes of the features in which noise is white and the signal's covariance diagonal.

    Attributes
    ----------
    whiten : (d, d) array
        Features times this are in the basis.
    strength : (d,) array
        Variances of the signal along the axes, of the noise 1.
    counted : float
        Share of the noise that comes of counting only so many samples.
    """

    whiten: np.ndarray
    strength: np.ndarray
    counted: float = 0.0

    @classmethod
    def of(cls, signal: np.ndarray, noise: np.ndarray, samples: int | None) -> Basis:
        """Of the variances ``(d,)`` of the signal and the noise covariance ``(d, d)``, larger where
        only so many samples were counted.
        """
        counted = 0.0 if samples is None else 0.25 / samples  # variance of the root of a frequency
        lengths, axes = np.linalg.eigh(noise + counted * np.eye(len(noise)))
        white = axes / np.sqrt(np.maximum(lengths, lengths[-1] * 1e-9 + 1e-12))
        strength, turn = np.linalg.eigh(white.T @ (signal[:, None] * white))
        share = counted * float(np.square(white).sum()) / len(noise)
        return cls(white @ turn, np.maximum(strength, 0), share)


class Table:
    """The field's likelihood at every cell, arranged so that a frame costs one product.

    In the basis the squared distance at a cell is the sum over features of (y - m)^2 / (1 + v s),
    which is linear in y^2 and y.
    """

    def __init__(self, mean: np.ndarray, variance: np.ndarray, basis: Basis):
        """Of the field's ``(M, d)`` mean and ``(M,)`` variance at the cells."""
        mean = mean @ basis.whiten
        total = 1 + variance[:, None] * basis.strength
        self.basis, self.log_norm = basis, -0.5 * np.log(total).sum(axis=1)
        self.weights = np.hstack([1 / total, -2 * mean / total]).astype(np.float32)
        self.constant = (np.square(mean) / total).sum(axis=1)

    def log_likelihood(self, features: np.ndarray) -> np.ndarray:
        """``(M,)`` for features ``(d,)``, or ``(n, M)`` for ``(n, d)``, up to a constant."""
        squared = np.maximum(self._both(features) @ self.weights.T + self.constant, 0)
        half = 0.5 * (DEGREES_OF_FREEDOM + features.shape[-1])
        return self.log_norm - half * np.log1p(squared / DEGREES_OF_FREEDOM)

    def squared_residual(self, features: np.ndarray, cells: np.ndarray) -> np.ndarray:
        """``(N,)`` squared deviations a feature of features ``(N, d)``, each at its cell."""
        products = np.einsum("nd,nd->n", self._both(features), self.weights[cells])
        return np.maximum(products + self.constant[cells], 0) / features.shape[-1]

    def _both(self, features: np.ndarray) -> np.ndarray:
        """Squares of features in the basis, and they, side by side, in single precision."""
        features = features @ self.basis.whiten
        return np.concatenate([features * features, features], axis=-1).astype(np.float32)


class TileTables:
    """The likelihoods of an image's tiles, each with a Student distribution of its own: a tile that
    shows what is new there, a rug or a shadow, takes nothing away from what the others tell.
    """

    def __init__(self, means: Sequence[np.ndarray], variance: np.ndarray, bases: Sequence[Basis]):
        """Of the field's ``(M, k)`` mean for each tile, and its ``(M,)`` variance at the cells."""
        both = zip(means, bases, strict=True)
        self.tables = [Table(mean, variance, basis) for mean, basis in both]
        # Of a place of which nothing is known.
        self.anywhere = [Table(np.zeros((1, len(each.whiten))), np.ones(1), each) for each in bases]

    def log_likelihoods(self, features: np.ndarray) -> np.ndarray:
        """``(C, ..., M)``, tile by tile, for features ``(..., d)``.

        A tile of several may show what was not there: a mixture at every cell.
        """
        all_likely, tiles = [], np.split(features, len(self.tables), axis=-1)
        for tile, table, anywhere in zip(tiles, self.tables, self.anywhere, strict=True):
            likely = table.log_likelihood(tile)
            if len(tiles) > 1:
                clutter = anywhere.log_likelihood(tile) + np.log(CLUTTER_SHARE)
                likely = np.logaddexp(likely, clutter)
            all_likely.append(likely)
        return np.stack(all_likely)

    def squared_residuals(self, features: np.ndarray, cells: np.ndarray) -> np.ndarray:
        """``(C, N)`` squared deviations a feature of frames ``(N, d)``, each at its cell."""
        both = zip(self.tables, np.split(features, len(self.tables), axis=-1), strict=True)
        return np.stack([table.squared_residual(tile, cells) for table, tile in both])

    def familiar_residual(self, scale: float) -> float:
        """Squared residual of familiar frames, which is `scale` where every patch is counted: the
        fewer are, the more of the noise comes of counting, and is as large on any floor.
        """
        share = float(np.mean([table.basis.counted for table in self.tables]))
        return scale + share * max(0.0, COUNTED_RESIDUAL - scale)


def better_half(residuals: np.ndarray) -> np.ndarray:
    """Mean over the better half of the tiles, which come first in ``(C, ...)`` residuals."""
    return np.sort(residuals, axis=0)[: len(residuals) // 2 + 1].mean(axis=0)


def rbf_kernel(centers: np.ndarray, places: np.ndarray, length: float) -> np.ndarray:
    """``(M, N)`` radial basis functions around the places, of a third of the length."""
    squared = np.square(centers).sum(axis=1)[:, None] + np.square(places).sum(axis=1)
    return np.exp(-4.5 / length**2 * (squared - 2 * centers @ places.T))


def matern(places: np.ndarray, others: np.ndarray, length: float) -> np.ndarray:
    """``(N, M)`` Matern kernel with nu = 3/2 (R&W 4.17): rough enough for the edges of a floor."""
    result, squared = 2 * places @ others.T, np.square(others).sum(axis=1)
    for first in range(0, len(places), 64):  # rows that stay in the processor's cache
        block, own = result[first : first + 64], places[first : first + 64]
        np.subtract(np.square(own).sum(axis=1)[:, None] + squared, block, out=block)
        np.sqrt(np.maximum(block, 0, out=block), out=block)
        block *= np.sqrt(3) / length
        decay = np.exp(-block)
        block += 1
        block *= decay
    return result


def kernels(places: np.ndarray, others: np.ndarray, length: float) -> Iterator[np.ndarray]:
    """`matern` in slices that stay small."""
    for first in range(0, len(places), 128):
        yield matern(places[first : first + 128], others, length)


def posterior_mean(
    places: np.ndarray, others: np.ndarray, weights: np.ndarray, length: float
) -> np.ndarray:
    """``(M, K)`` at places, of a process with weights ``(N, K)`` at others (R&W 2.25)."""
    return np.concatenate([kernel @ weights for kernel in kernels(places, others, length)])


def log_prior(density: np.ndarray, counted: bool = True) -> np.ndarray:
    """``(M,)`` log of a density over the uniform one, part of which is mixed in, more
    where values are not `counted`; 0 where there is none anywhere.
    """
    mean = density.mean()
    if mean == 0:
        return np.zeros_like(density)
    uniform = UNIFORM_SHARE if counted else WIDE_UNIFORM_SHARE
    return np.log((1 - uniform) * density / mean + uniform)


def tile_bases(
    signal: np.ndarray, noise: np.ndarray, parts: int, samples: int | None = None
) -> list[Basis]:
    """The basis of each tile, to which a block of the signal ``(d,)`` and the noise ``(d, d)``
    belong.
    """
    tiles = np.split(np.arange(len(signal)), parts)
    return [Basis.of(signal[tile], noise[np.ix_(tile, tile)], samples) for tile in tiles]


def grid_cells(area: Area, cells: int) -> tuple[np.ndarray, tuple[int, int]]:
    """``(M, 2)`` centres of about `cells` squares, x slowest, and how many along x and y."""
    x_min, x_max, y_min, y_max = area
    side = np.sqrt((x_max - x_min) * (y_max - y_min) / cells)
    most = max(2, cells // 2)  # of a strip: two beside another
    nx, ny = (
        min(max(2, round((high - low) / side)), most)
        for low, high in ((x_min, x_max), (y_min, y_max))
    )
    x = x_min + (np.arange(nx) + 0.5) * (x_max - x_min) / nx
    y = y_min + (np.arange(ny) + 0.5) * (y_max - y_min) / ny
    return np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1).reshape(-1, 2), (nx, ny)


def bilinear(grid: np.ndarray, area: np.ndarray, places: np.ndarray) -> np.ndarray:
    """``(M,)`` values of a grid ``(nx, ny)`` over the area, constant beyond its outer centres."""
    places = np.asarray(places, dtype=float)
    count = np.array(grid.shape)
    low, high = area[::2], area[1::2]
    at = np.clip((places - low) / (high - low) * count - 0.5, 0, count - 1)
    first = np.minimum(at.astype(np.int64), count - 2)
    (u, v), (i, j) = (at - first).T, first.T
    result: np.ndarray = (1 - u) * ((1 - v) * grid[i, j] + v * grid[i, j + 1])
    result += u * ((1 - v) * grid[i + 1, j] + v * grid[i + 1, j + 1])
    return result


def peaks(
    cells: np.ndarray, shares: np.ndarray, radius: float
) -> Iterator[tuple[np.ndarray, np.ndarray, float]]:
    """Means ``(2,)``, covariances ``(2, 2)`` and shares of the likeliest places, of a likelihood
    `shares` ``(M,)`` over `cells` ``(M, 2)``, each of what lies within `radius` metres.
    """
    left = shares.copy()
    for _ in range(PEAKS):
        best = int(left.argmax())
        near = np.hypot(*(cells - cells[best]).T) < radius
        mass = float(left[near].sum())
        if mass < PEAK_MASS:
            break
        part = left[near] / mass
        left[near] = 0
        mean = part @ cells[near]
        offset = cells[near] - mean
        yield mean, (offset.T * part) @ offset, mass


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """Errors of single frames: a first-order Gauss-Markov process, AR(1), and white noise.

    Attributes
    ----------
    correlated_sigma, white_sigma : float
        Standard deviations along one axis, metres.
    time_constant_s : float
        Of the correlated error.
    """

    correlated_sigma: float
    white_sigma: float
    time_constant_s: float

    @classmethod
    def of(cls, errors: np.ndarray, time: np.ndarray, finest: float) -> ErrorModel:
        """From ``(N, 2)`` errors of frames; `finest` is the least that `white_sigma` may be.

        Outliers are shortened to three median lengths: they are the likelihood's affair.
        """
        length = np.hypot(*errors.T)
        limit = max(3 * float(np.median(length)), finest)
        errors = errors * np.minimum(1, limit / np.maximum(length, 1e-12))[:, None]
        period = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
        variance = float(np.square(errors).mean())

        def correlation(lag: int) -> float:
            regular = np.abs(time[lag:] - time[:-lag] - lag * period) < 0.5 * period
            if regular.sum() < 4 or variance <= 0:
                return 0.0
            return float((errors[lag:] * errors[:-lag])[regular].mean() / variance)

        first, second = correlation(1), correlation(2)
        if first < 0.05 or second <= 0:
            return cls(np.sqrt(variance / 2), max(np.sqrt(variance / 2), finest), period)
        memory = float(np.clip(second / first, 0.2, 0.98))
        share = float(np.clip(first / memory, 0.25, 1.0))
        white = max(np.sqrt(variance * (1 - share)), finest)
        return cls(np.sqrt(variance * share), white, -period / np.log(memory))


def error_terms(variances: np.ndarray) -> np.ndarray:
    """``(M, 3)`` regressors of the mean error: 1, the root of unexplained over explained variance,
    and that ratio itself, of the field's `variances` ``(M,)`` as shares of the signal.

    With a larger variance a place is located less exactly; where next to nothing is explained it is
    indistinguishable from others.
    """
    variances = np.maximum(variances, 0.0)
    ratio = variances / np.maximum(1 - variances, MIN_EXPLAINED)
    return np.column_stack([np.ones_like(ratio), np.sqrt(ratio), ratio])
