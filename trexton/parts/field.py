"""Measurement by a field: at which places this histogram would be seen, and how sure the field
is there.

Of histograms the features of `trexton.field.features` are taken: roots of frequencies, or what
other values ask for. Their field is learned as Gaussian processes (`trexton.field.process`), their
noise from blocks of the training flight that were left out. What is left of a frame at a place
follows a Student distribution, so that one odd feature rules out no place for good.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np
from scipy.spatial import cKDTree

from trexton.errors import MapError, ParameterError
from trexton.field.blocks import Block, blocks_in_space, blocks_in_time
from trexton.field.error_model import ErrorModel
from trexton.field.features import Features
from trexton.field.process import Process, choose_length, merge_places
from trexton.observation import Observation
from trexton.parts.base import Area, Training, learned
from trexton.parts.measurement import MeasurementModel

__all__ = ["Field", "grid_cells"]

DEGREES = 6.0  # of freedom of the Student distribution
STUDIED = 800  # frames that noise, length and errors are learned from; longer flights are thinned
COARSE = 1200  # cells of the grid on which left-out frames are located
# Cells times features: what a frame may cost, and how much of the processor's cache it may fill.
LARGEST_TABLE = 600_000
LEAST = 1e-3  # variance, as a share of the signal: no place is taken to be known better
FARTHEST = 1e6  # deviations of a feature: beyond, squares would overflow
USUAL = 0.95  # share of left-out frames that look like what was surveyed, see `Field.strangeness`
UNFLOWN = 0.1  # share of the prior that does not expect the vehicle where it was in training


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


@dataclass(eq=False)
class Field(MeasurementModel):
    """The likelihood of a histogram over the whole floor, from processes of the training flight.

    Parameters
    ----------
    cells : int
        About how many squares the floor is divided into; fewer where there are many features.
    """

    cells: int = 4800
    axes: np.ndarray = learned()  # (K, d) of `Features`, and
    signed: np.ndarray = learned()  # () whether they are those of values
    center: np.ndarray = learned()  # (d,) their means
    signal: np.ndarray = learned()  # (d,) their variances over the floor
    noise: np.ndarray = learned()  # (d, d) their covariance from frame to frame
    mean: np.ndarray = learned()  # (M, d) the field at the cells, less the centre
    variance: np.ndarray = learned()  # (M,) its variance there, as a share of the signal
    prior: np.ndarray = learned()  # (M,) log of where the training flight was
    area: np.ndarray = learned()  # (4,)
    errors: np.ndarray = learned()  # (3,) an ErrorModel
    learnt_at: np.ndarray = learned()  # () the variance where the frames behind it were
    repeated: np.ndarray = learned()  # () see `lasting_growth`
    misfit: np.ndarray = learned()  # () see `strangeness`
    expected: np.ndarray = learned()  # (2,) expected error: without variance, times its root

    def check(self) -> None:
        if not 16 <= self.cells <= 1_000_000:
            raise ParameterError(f"{self.cells} cells were asked for: expected 16 to 1000000")

    def fit(self, training: Training) -> Self:
        """Learn field, noise and errors.

        Raises
        ------
        MapError
            All histograms are alike.
        """
        from threadpoolctl import threadpool_limits

        with threadpool_limits(1, user_api="blas"):  # sums are rounded alike on any machine
            taken = Features.of(training.histograms)
            features = np.asfortranarray(taken(training.histograms))  # for sums of columns
        if not features.shape[1]:
            raise MapError(
                f"all {len(features)} training histograms are alike: no place can be told from "
                "another, record a flight over a floor with some pattern"
            )
        # Far from where x and y are zero distances would be rounded: that moves by kilometres.
        origin = training.positions.mean(axis=0).round(-3)
        places, area = training.positions - origin, _moved(training.area, -origin)
        if not np.ptp(places, axis=0).any():
            raise MapError(
                f"all {len(places)} training positions are one place: fly over the floor"
            )
        center = features.mean(axis=0)
        cells = min(self.cells, max(16, LARGEST_TABLE // features.shape[1]))
        centers, _ = grid_cells(area, cells)
        with threadpool_limits(1, user_api="blas"):
            study = _Study.of(places, features - center, training.time, area)
            merged, values, counts = merge_places(places, features - center)
            process = Process.fit(merged, values, study.length, counts)
            mean, variance = process.predict(centers)
            prior = _relative(_bumps(centers, merged, process.length) @ counts)
        return self.with_learned(
            axes=taken.axes,
            signed=np.array(taken.signed),
            center=center,
            signal=study.signal,
            noise=study.noise,
            mean=mean.astype(np.float32),
            variance=variance,
            prior=prior,
            area=np.array(training.area, dtype=float),
            errors=np.array([study.model.lasting, study.model.fresh, study.model.lasts_s]),
            learnt_at=np.array(study.learnt_at),
            repeated=np.array(study.repeated),
            misfit=np.array(study.misfit),
            expected=study.expected,
        )

    @property
    def width(self) -> int:
        return len(self.axes)

    def prepare(self) -> None:
        """Raise `MapError` for arrays that do not fit each other."""
        d, count = len(self.center), len(self.variance)
        shapes = {
            "axes": (len(self.axes), d), "signed": (), "signal": (d,), "noise": (d, d),
            "mean": (count, d), "prior": (count,), "area": (4,), "errors": (3,), "learnt_at": (),
            "repeated": (), "misfit": (), "expected": (2,),
        }  # fmt: skip
        for name, shape in shapes.items():
            array = getattr(self, name)
            if array.shape != shape or not np.isfinite(array).all():
                raise MapError(f"the field's {name} has shape {array.shape}: expected {shape}")
        wanted = min(self.cells, max(16, LARGEST_TABLE // d))
        self.centers, self.shape = grid_cells(tuple(self.area.tolist()), wanted)
        if len(self.centers) != count:
            raise MapError(f"the field has {count} cells and {d} features that fit no grid")
        self.features = Features(self.axes, bool(self.signed))
        self._tables: dict[int | None, tuple[np.ndarray, _Table]] = {}

    @cached_property
    def error_model(self) -> ErrorModel:
        """How single frames err."""
        return ErrorModel(*self.errors.tolist())

    @property
    def cell(self) -> float:
        """Side of a cell in metres."""
        x_min, x_max, y_min, y_max = self.area
        return float(np.sqrt((x_max - x_min) * (y_max - y_min) / len(self.centers)))

    def look(self, observation: Observation) -> None:
        observation.histogram  # noqa: B018  drawn before the filter draws

    def over_cells(self, observation: Observation) -> np.ndarray:
        """``(M,)`` log of likelihood times prior at the centres of the cells, less a constant."""
        whiten, table = self._table(observation.samples)
        limit = FARTHEST * np.sqrt(self.signal)
        features = np.clip(self.features(observation.histogram) - self.center, -limit, limit)
        found: np.ndarray = table.log_likelihood(features @ whiten) + self.prior
        return found

    def _table(self, samples: int | None) -> tuple[np.ndarray, _Table]:
        """Axes in which the noise of so many samples is white, and the field along them."""
        if samples not in self._tables:
            basis = _Basis.of(self.signal, self.noise, samples)
            table = _Table.of(self.mean @ basis.whiten, self.variance, basis.strength)
            self._tables[samples] = basis.whiten, table
        return self._tables[samples]

    def strangeness(self, observation: Observation, found: np.ndarray) -> float:
        """How far what was seen is from the field where it fits best, of which `found` by
        `over_cells` tells: below 1 for nineteen of twenty frames of the survey that were left out.
        """
        _, table = self._table(observation.samples)
        cell = int(found.argmax())
        far = table.misfit(found[cell] - self.prior[cell], cell)
        return float(far / max(float(self.misfit), LEAST))

    def log_likelihood(self, places: np.ndarray, observation: Observation) -> np.ndarray:
        grid = self.over_cells(observation).reshape(self.shape)
        return _bilinear(grid, self.area, places)

    def lasting_growth(self, places: np.ndarray) -> np.ndarray:
        """``(M,)`` factors, one at least, on the variance of lasting errors at `places` ``(M, 2)``.

        Errors grow with the root of the field's variance (see `expected_error`). Between the
        passes of a survey it is larger than where the errors were learned; and where a survey
        repeats its passes, they were learned nearer to it than a later flight will be.
        """
        between = self._variance_at(places) / max(float(self.learnt_at), LEAST)
        return float(self.repeated) * np.maximum(1.0, between)

    def expected_error(self, places: np.ndarray) -> np.ndarray:
        """``(M,)`` metres by which a single frame is expected to err at `places` ``(M, 2)``."""
        root = np.sqrt(self._variance_at(places))
        expected: np.ndarray = self.expected[0] + self.expected[1] * root
        return expected

    def _variance_at(self, places: np.ndarray) -> np.ndarray:
        return _bilinear(self.variance.reshape(self.shape), self.area, places)


@dataclass(frozen=True, eq=False)
class _Basis:
    """Axes of the features in which noise is white and the signal's covariance diagonal.

    Attributes
    ----------
    whiten : (d, d) array
        Features times this are in the basis.
    strength : (d,) array
        Variances of the signal along the axes, of the noise 1.
    """

    whiten: np.ndarray
    strength: np.ndarray

    @classmethod
    def of(cls, signal: np.ndarray, noise: np.ndarray, samples: int | None) -> _Basis:
        counted = 0.0 if samples is None else 0.25 / samples  # variance of the root of a frequency
        lengths, axes = np.linalg.eigh(noise + counted * np.eye(len(noise)))
        white = axes / np.sqrt(np.maximum(lengths, lengths[-1] * 1e-9 + 1e-12))
        strength, turn = np.linalg.eigh(white.T @ (signal[:, None] * white))
        return cls(white @ turn, np.maximum(strength, 0))


@dataclass(frozen=True, eq=False)
class _Table:
    """The field's likelihood at every cell, arranged so that a frame costs one product.

    In the basis the squared distance at a cell is the sum over features of (y - m)^2 / (1 + v s),
    which is linear in y^2 and y.
    """

    weights: np.ndarray
    constant: np.ndarray
    log_norm: np.ndarray

    @classmethod
    def of(cls, mean: np.ndarray, variance: np.ndarray, strength: np.ndarray) -> _Table:
        total = 1 + variance[:, None] * strength
        weights = np.hstack([1 / total, -2 * mean / total]).astype(np.float32)
        constant = (np.square(mean) / total).sum(axis=1)
        return cls(weights, constant, -0.5 * np.log(total).sum(axis=1))

    def misfit(self, found: np.ndarray, cells: np.ndarray | int) -> np.ndarray:
        """Squared deviations a feature from which `log_likelihood` made `found` at `cells`."""
        d = self.weights.shape[1] // 2
        squared = np.expm1((self.log_norm[cells] - found) / (0.5 * (DEGREES + d)))
        result: np.ndarray = DEGREES / d * squared
        return result

    def log_likelihood(self, features: np.ndarray) -> np.ndarray:
        """``(M,)`` for features ``(d,)``, or ``(n, M)`` for ``(n, d)``, up to a constant."""
        both = np.concatenate([features * features, features], axis=-1).astype(np.float32)
        squared = np.maximum(both @ self.weights.T + self.constant, 0)
        half = 0.5 * (DEGREES + features.shape[-1])
        found: np.ndarray = self.log_norm - half * np.log1p(squared / DEGREES)
        return found


@dataclass(frozen=True, eq=False)
class _Study:
    """What left-out blocks teach: the kernel's length, signal and noise of features, and errors.

    Attributes
    ----------
    length : float
        Metres.
    signal : (d,) array
    noise : (d, d) array
    model : ErrorModel
    expected : (2,) array
        See `Field.expected_error`.
    learnt_at : float
        Median of the field's variance where the left-out frames were.
    repeated : float
        See `Field.lasting_growth`.
    misfit : float
        Squared deviation a feature that `USUAL` of the left-out frames do not exceed where they fit
        best.
    """

    length: float
    signal: np.ndarray
    noise: np.ndarray
    model: ErrorModel
    expected: np.ndarray
    learnt_at: float
    repeated: float
    misfit: float

    @classmethod
    def of(cls, places: np.ndarray, features: np.ndarray, time: np.ndarray, area: Area) -> _Study:
        """Study a flight; `features` ``(N, d)`` have mean zero."""
        step = -(-len(places) // STUDIED)
        places, features, time = places[::step], features[::step], time[::step]
        diagonal = max(float(np.hypot(*np.ptp(places, axis=0))), 1e-3)
        blocks = blocks_in_time(time)
        process, residuals, uncertain = choose_length(places, features, blocks, diagonal)
        signal = (np.square(residuals) / uncertain[:, None]).mean(axis=0)
        noise = _noise(residuals, uncertain)
        basis = _Basis.of(signal, noise, None)
        process = replace(process, weights=process.weights @ basis.whiten)
        features = features @ basis.whiten
        centers, _ = grid_cells(area, COARSE)
        finest = 0.25 * np.sqrt((area[1] - area[0]) * (area[3] - area[2]) / len(centers))
        errors, variances, misfits = _errors(process, features, basis.strength, blocks, centers)
        model = ErrorModel.of(errors, time, finest)
        apart = blocks_in_space(blocks, places, time, _strays(centers, places, process.length))
        repeated = 1.0
        if apart != blocks:
            there, _, _ = _errors(process, features, basis.strength, apart, centers)
            repeated = max(1.0, (ErrorModel.of(there, time, finest).lasting / model.lasting) ** 2)
        growth, learnt_at = _growth(errors, variances), float(np.median(variances))
        misfit = float(np.quantile(misfits, USUAL))
        return cls(process.length, signal, noise, model, growth, learnt_at, repeated, misfit)


def _errors(
    process: Process,
    features: np.ndarray,
    strength: np.ndarray,
    blocks: Sequence[Block],
    centers: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """``(N, 2)`` metres by which frames are misplaced without their block, each by itself,
    ``(N,)`` the field's variance at their places then, and ``(N,)`` their squared deviations a
    feature where they fit best.
    """
    places = process.places
    errors, variances, misfits = np.empty_like(places), *np.empty((2, len(places)))
    density = _bumps(centers, places, process.length)
    for block, mean, variance in process.predict_without(blocks, centers):
        rows, out = block.rows, block.left_out
        prior = _relative(density.sum(axis=1) - density[:, out].sum(axis=1))
        table = _Table.of(mean, variance, strength)
        found = table.log_likelihood(features[rows]) + prior
        best = found.argmax(axis=1)
        misfits[rows] = table.misfit(found.max(axis=1) - prior[best], best)
        found = np.exp(found - found.max(axis=1, keepdims=True))
        found /= found.sum(axis=1, keepdims=True)
        errors[rows] = found @ centers - places[rows]
        near = np.square(places[rows][:, None] - centers).sum(axis=2).argmin(axis=1)
        variances[rows] = variance[near]
    return errors, variances, misfits


def _noise(errors: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """``(d, d)`` covariance where the field is known best, shrunk towards its diagonal."""
    count, d = errors.shape
    best = np.argsort(variances, kind="stable")[: max(count // 2, min(count, 2 * d))]
    covariance = errors[best].T @ errors[best] / len(best)
    shrink = max(0.1, d / (d + len(best)))
    diagonal = np.diag(covariance)
    floor = 1e-3 * diagonal.mean() + 1e-12  # a feature that never erred here will elsewhere
    shrunk: np.ndarray = (1 - shrink) * covariance + np.diag(shrink * diagonal + floor)
    return shrunk


def _moved(area: Area, by: np.ndarray) -> Area:
    (x, y), (x_min, x_max, y_min, y_max) = by.tolist(), area
    return x_min + x, x_max + x, y_min + y, y_max + y


def _bumps(centers: np.ndarray, places: np.ndarray, length: float) -> np.ndarray:
    """``(M, N)`` Gaussian bumps around the places, a third of the length wide."""
    squared = np.square(centers).sum(axis=1)[:, None] + np.square(places).sum(axis=1)
    bumps: np.ndarray = np.exp(-4.5 / length**2 * (squared - 2 * centers @ places.T))
    return bumps


def _strays(centers: np.ndarray, places: np.ndarray, length: float) -> float:
    """Metres from where a later flight is expected to the nearest of the places, on average.

    It is expected half as far from them as the prior allows.
    """
    expected = np.exp(_relative(_bumps(centers, places, length / 2).sum(axis=1)))
    return float(np.average(cKDTree(places).query(centers)[0], weights=expected))


def _relative(density: np.ndarray) -> np.ndarray:
    """``(M,)`` log of a density over the uniform one, part of which is mixed in."""
    relative: np.ndarray = np.log((1 - UNFLOWN) * density / density.mean() + UNFLOWN)
    return relative


def _growth(errors: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """``(2,)`` non-negative a and b of |error| = a + b sqrt(variance), by least squares."""
    length, root = np.hypot(*errors.T), np.sqrt(np.maximum(variances, 0))
    if np.ptp(root) < 1e-9:
        return np.array([length.mean(), 0.0])
    slope, start = np.polyfit(root, length, 1)
    if slope < 0:
        return np.array([length.mean(), 0.0])
    if start < 0:
        return np.array([0.0, (length @ root) / (root @ root)])
    return np.array([start, slope])


def _bilinear(grid: np.ndarray, area: np.ndarray, places: np.ndarray) -> np.ndarray:
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
