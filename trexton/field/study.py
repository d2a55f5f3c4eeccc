"""What a training flight teaches of its own field: blocks of it are left out and located."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import cKDTree

from trexton.field.blocks import Block, blocks_in_space, blocks_in_time
from trexton.field.error_model import ErrorModel, unknown
from trexton.field.grid import grid_cells
from trexton.field.likelihood import Basis, Table, bumps, relative
from trexton.field.process import Process, choose_length
from trexton.field.tiles import Tiles
from trexton.localization.base import Area

__all__ = ["Study"]

STUDIED = 800  # frames that noise, length and errors are learned from; longer flights are thinned
USUAL = 0.95  # share of left-out frames that look like what was surveyed, see `Field.strangeness`
COARSE = 1200  # cells of the grid on which left-out frames are located


@dataclass(frozen=True, eq=False)
class Study:
    """What left-out blocks teach: the kernel's length, signal and noise of features, and errors.

    Attributes
    ----------
    length : float
        Metres.
    signal : (d,) array
    noise : (d, d) array
    model : ErrorModel
    expected : (3,) array
        See `Field.expected_error`.
    learned_at : float
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
    learned_at: float
    repeated: float
    misfit: float

    @classmethod
    def of(
        cls,
        places: np.ndarray,
        features: np.ndarray,
        time: np.ndarray,
        area: Area,
        tiles: Tiles,
    ) -> Study:
        """Study a flight; `features` ``(N, d)``, part after part as `tiles` places them, have mean
        zero.
        """
        step = -(-len(places) // STUDIED)
        places, features, time = places[::step], features[::step], time[::step]
        diagonal = max(float(np.hypot(*np.ptp(places, axis=0))), 1e-3)
        blocks, parts = blocks_in_time(time), len(tiles.offsets)
        # All frames are located, but the processes hold no more rows than of whole frames.
        every = -(-len(places) * parts // STUDIED)
        seen, seen_blocks = tiles.places(places[::every]), tiles.blocks(blocks, every)
        held = features[::every].reshape(len(seen), -1)
        process, residuals, uncertain = choose_length(seen, held, seen_blocks, diagonal)
        signal = np.tile((np.square(residuals) / uncertain[:, None]).mean(axis=0), parts)
        frames = len(seen) // parts
        noise = _noise(residuals.reshape(frames, -1), uncertain.reshape(frames, parts).mean(axis=1))
        basis = Basis.of(signal, noise, None)
        centers, _ = grid_cells(area, COARSE)
        finest = 0.25 * np.sqrt((area[1] - area[0]) * (area[3] - area[2]) / len(centers))
        flown = np.repeat(places[::every], parts, axis=0)
        flight = _Flight(places, features @ basis.whiten, blocks, tiles, flown)
        errors, variances, misfits = flight.errors(process, basis, seen_blocks, centers)
        model = ErrorModel.of(errors, time, finest)
        strays = _strays(centers, places, seen, process.length, tiles)
        moments = np.repeat(time[::every], parts)
        apart = blocks_in_space(seen_blocks, seen, moments, strays)
        repeated = 1.0
        if apart != seen_blocks:
            there, _, _ = flight.errors(process, basis, apart, centers)
            repeated = max(1.0, (ErrorModel.of(there, time, finest).lasting / model.lasting) ** 2)
        growth, learned_at = _growth(errors, variances), float(np.median(variances))
        misfit = float(np.quantile(misfits, USUAL))
        return cls(process.length, signal, noise, model, growth, learned_at, repeated, misfit)


@dataclass(frozen=True, eq=False)
class _Flight:
    """Frames to locate: their places, features in a basis, and blocks that are left out; and for
    each row of a process the place of its frame.
    """

    places: np.ndarray
    features: np.ndarray
    blocks: Sequence[Block]
    tiles: Tiles
    flown: np.ndarray

    def errors(
        self, process: Process, basis: Basis, left_out: Sequence[Block], centers: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """``(N, 2)`` metres by which frames are misplaced without their block, each by itself,
        ``(N,)`` the field's variance at their places then, and ``(N,)`` their squared deviations a
        feature where they fit best; of the process the rows in `left_out` are left out.
        """
        places, offsets = self.places, self.tiles.offsets
        errors, variances, misfits = np.empty_like(places), *np.empty((2, len(places)))
        density = bumps(centers, self.flown, process.length)
        everywhere = density.sum(axis=1)
        # The field along the basis is a sum over the parts of an image.
        shares = np.split(basis.whiten, len(offsets))
        predictions = zip(
            *(
                replace(process, weights=process.weights @ share).predict_without(
                    left_out, centers + offset
                )
                for share, offset in zip(shares, offsets, strict=True)
            ),
            strict=True,
        )
        for block, parts in zip(self.blocks, predictions, strict=True):
            (gone, *_), means, spreads = zip(*parts, strict=True)
            mean, variance = sum(means[1:], means[0]), sum(spreads[1:], spreads[0]) / len(parts)
            rows = block.rows
            prior = relative(everywhere - density[:, gone.left_out].sum(axis=1))
            table = Table.of(mean, variance, basis.strength)
            found = table.log_likelihood(self.features[rows]) + prior
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


def _strays(
    centers: np.ndarray, places: np.ndarray, seen: np.ndarray, length: float, tiles: Tiles
) -> float:
    """Metres from what a later flight is expected to show to the nearest that was seen, on average.

    It is expected half as far from the places of the survey as the prior allows.
    """
    expected = np.exp(relative(bumps(centers, places, length / 2).sum(axis=1)))
    apart = cKDTree(seen).query(tiles.places(centers))[0].reshape(len(centers), -1)
    return float(np.average(apart.mean(axis=1), weights=expected))


def _growth(errors: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """``(3,)`` non-negative factors of `unknown` whose sum is nearest to the lengths of the
    errors.
    """
    lengths = np.hypot(*errors.T)
    if np.ptp(variances) < 1e-9:  # nothing to tell the terms apart
        return np.array([lengths.mean(), 0.0, 0.0])
    factors: np.ndarray = nnls(unknown(variances), lengths)[0]
    return factors
