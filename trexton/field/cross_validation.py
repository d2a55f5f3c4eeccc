"""Leave-neighbours-out cross-validation: blocks of a training flight are located by a field of the
rest. Offers `cross_validate`, which gives the field's hyperparameters and a model of its errors."""

from collections.abc import Sequence
from dataclasses import astuple
from functools import partial

import numpy as np
from scipy.optimize import nnls
from scipy.spatial import cKDTree

from trexton.base.progress import say
from trexton.field.features import Features
from trexton.field.likelihood import (
    Basis,
    ErrorModel,
    TileTables,
    better_half,
    error_terms,
    grid_cells,
    log_prior,
    rbf_kernel,
    tile_bases,
)
from trexton.field.process import (
    NOISES,
    Block,
    Process,
    blocks_in_space,
    blocks_in_time,
    select_length,
)
from trexton.field.tiles import Tiles
from trexton.localization.base import Area

MAX_FRAMES = 800  # of which it takes place; longer flights are thinned
FAMILIAR_SHARE = 0.95  # of left-out frames whose normalized residual is at most 1
CELLS = 1200  # of the grid on which left-out frames are located
OWN_CELLS = 10.0  # around its place in which a hypothesis takes a frame for its own


def cross_validate(
    places: np.ndarray,
    features: np.ndarray,
    time: np.ndarray,
    area: Area,
    tiles: Tiles,
    counted: bool = True,
) -> tuple[Process, dict[str, np.ndarray], float]:
    """What left-out blocks teach of a flight, whose `features` ``(N, d)`` have mean zero and stand
    tile after tile. Of values that are not `counted` the noise is chosen, too.

    Returns
    -------
    Process
        With the length of the kernel and the noise that were chosen.
    dict of str to array
        What a `Field` learns of noise and errors, by its names.
    float
        Mean error in metres of left-out frames, each located alone.
    """
    step = -(-len(places) // MAX_FRAMES)
    places, features, time = places[::step], features[::step], time[::step]
    diagonal = max(float(np.hypot(*np.ptp(places, axis=0))), 1e-3)
    blocks, parts = blocks_in_time(time), len(tiles.offsets)
    # All frames are located, but the processes hold no more rows than of whole frames.
    every = -(-len(places) * parts // MAX_FRAMES)
    rows, row_blocks = tiles.places(places[::every]), tiles.blocks(blocks, every)
    held = features[::every].reshape(len(rows), -1)
    process, residuals, uncertain = select_length(
        rows, held, row_blocks, diagonal, NOISES[:1] if counted else NOISES
    )
    signal = np.tile((np.square(residuals) / uncertain[:, None]).mean(axis=0), parts)
    frames = len(rows) // parts
    noise = _noise(residuals.reshape(frames, -1), uncertain.reshape(frames, parts).mean(axis=1))
    bases = tile_bases(signal, noise, parts)
    centers, _ = grid_cells(area, CELLS)
    finest = 0.25 * np.sqrt((area[1] - area[0]) * (area[3] - area[2]) / len(centers))
    flown = np.repeat(places[::every], parts, axis=0)
    located = partial(_located, process, tiles, bases, centers, places, features, blocks, flown)
    errors, own, variances, squared = located(row_blocks, counted)
    model = ErrorModel.of(own, time, finest)
    later = _prediction_distance(centers, places, rows, process.length, tiles, counted)
    wider = blocks_in_space(row_blocks, rows, np.repeat(time[::every], parts), later)
    revisit_inflation = 1.0
    if wider != row_blocks:
        _, there, _, _ = located(wider, counted)
        ratio = ErrorModel.of(there, time, finest).correlated_sigma / model.correlated_sigma
        revisit_inflation = max(1.0, ratio**2)
    learned = {
        "signal": signal,
        "noise": noise,
        "errors": np.array(astuple(model)),
        "error_coefficients": _error_coefficients(errors, variances),
        # Where a sense is noisy its errors grow only once the field's variance exceeds the noise.
        "training_variance": np.median(variances) + (0.0 if counted else process.noise),
        "revisit_inflation": np.array(revisit_inflation),
        "residual_scale": np.quantile(squared, FAMILIAR_SHARE),
    }
    return process, learned, float(np.hypot(*errors.T).mean())


def select_features(
    candidates: Sequence[Features],
    histograms: np.ndarray,
    places: np.ndarray,
    time: np.ndarray,
    area: Area,
) -> Features:
    """Those by which left-out blocks of a flight are located best, of values that count nothing."""

    def error(taken: Features) -> float:
        values = taken(histograms)
        whole = Tiles(np.zeros((1, 2)))
        return cross_validate(places, values - values.mean(axis=0), time, area, whole, False)[2]

    if len(candidates) == 1:
        return candidates[0]
    best = min(candidates, key=error)
    say(f"features are taken {'as they are' if best is candidates[0] else 'along principal axes'}")
    return best


def _located(
    process: Process,
    tiles: Tiles,
    bases: Sequence[Basis],
    centers: np.ndarray,
    places: np.ndarray,
    features: np.ndarray,
    blocks: Sequence[Block],
    flown: np.ndarray,
    left_out: Sequence[Block],
    counted: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Of each frame, located alone without its block: ``(N, 2)`` errors in metres, those that a
    hypothesis sees, which where values are not `counted` takes only what is near, ``(N,)`` the
    field's variance at its place, and ``(N,)`` its squared residual a feature at the best cell.

    Of the process, whose rows are of frames that were `flown` there, those in `left_out` are left
    out, for each of the blocks of frames.
    """
    (errors, own), (variances, residuals) = np.empty((2, *places.shape)), np.empty((2, len(places)))
    density = rbf_kernel(centers, flown, process.length)
    everywhere, reach = density.sum(axis=1), OWN_CELLS * (centers[1, 1] - centers[0, 1])
    footprints = [centers + offset for offset in tiles.offsets]
    predictions = process.predict_without(left_out, footprints)
    for block, (gone, parts) in zip(blocks, predictions, strict=True):
        means, spreads = zip(*parts, strict=True)
        variance = sum(spreads[1:], spreads[0]) / len(parts)
        rows = block.rows
        prior = log_prior(everywhere - density[:, gone.left_out].sum(axis=1), counted)
        tables = TileTables(means, variance, bases)
        posterior = tables.log_likelihoods(features[rows]).sum(axis=0) + prior
        squared = tables.squared_residuals(features[rows], posterior.argmax(axis=1))
        residuals[rows] = better_half(squared)
        apart = np.square(places[rows][:, None] - centers).sum(axis=2)
        variances[rows] = variance[apart.argmin(axis=1)]
        kinds = [(errors, posterior)]
        if not counted:
            far = apart > np.maximum(apart.min(axis=1, keepdims=True), reach**2)
            kinds.append((own, np.where(far, -np.inf, posterior)))
        for found, kept in kinds:
            shares = np.exp(kept - kept.max(axis=1, keepdims=True))
            found[rows] = shares / shares.sum(axis=1, keepdims=True) @ centers - places[rows]
    return errors, errors if counted else own, variances, residuals


def _noise(errors: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """``(d, d)`` covariance where the field is known best, shrunk towards its diagonal."""
    count, d = errors.shape
    best = np.argsort(variances, kind="stable")[: max(count // 2, min(count, 2 * d))]
    covariance = errors[best].T @ errors[best] / len(best)
    shrink = max(0.1, d / (d + len(best)))
    diagonal = np.diag(covariance)
    floor = 1e-3 * diagonal.mean() + 1e-12  # a feature that never erred here will elsewhere
    return (1 - shrink) * covariance + np.diag(shrink * diagonal + floor)


def _prediction_distance(
    centers: np.ndarray,
    places: np.ndarray,
    rows: np.ndarray,
    length: float,
    tiles: Tiles,
    counted: bool,
) -> float:
    """Metres from what a later flight will show to the nearest of `rows`, on average.

    It is expected half as far from the places of the survey as the prior allows.
    """
    weights = np.exp(log_prior(rbf_kernel(centers, places, length / 2).sum(axis=1), counted))
    distance = cKDTree(rows).query(tiles.places(centers))[0].reshape(len(centers), -1)
    return float(np.average(distance.mean(axis=1), weights=weights))


def _error_coefficients(errors: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """``(3,)`` non-negative factors of `error_terms` that fit the lengths of the errors best."""
    lengths = np.hypot(*errors.T)
    if np.ptp(variances) < 1e-9:  # nothing to tell the terms apart
        return np.array([lengths.mean(), 0.0, 0.0])
    return nnls(error_terms(variances), lengths)[0]
