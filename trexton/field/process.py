"""Gaussian processes from places to features, one a feature, with one kernel; their predictions
with a block of the flight left out, and the choice of the kernel's length by them.

Equations after Rasmussen & Williams, "Gaussian Processes for Machine Learning" (2006): (2.25) and
(2.26) for mean and variance, Sec. 5.4.2 for predictions with a part left out. Shapes, throughout:
`places` are ``(N, 2)`` metres, `features` ``(N, K)``, variances are relative to each feature's
own signal variance.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import inv
from scipy.spatial.distance import cdist

from trexton.field.likelihood import kernels, matern
from trexton.vision.threads import ahead

# Noise of a frame as a share of the signal variance, what the field must not try to follow: of
# histograms, and what is tried for senses that may be noisier.
NOISE = 0.03
NOISES = (NOISE, 0.1, 0.3, 1.0, 3.0)
# Lengths that are tried, as shares of the diagonal of what was flown over.
LENGTHS = (0.03, 0.045, 0.07, 0.1, 0.15)
# Of a block, and of what is left out before and after it.
BLOCK_S, MARGIN_S = 1.0, 0.5
HALVINGS = 8  # of the margin, until the distance in space is near enough
MAX_PLACES = 1600  # places a process holds; more are merged, so that its price has an end


@dataclass(frozen=True, eq=False)
class Block:
    """Rows that are predicted, and those left out for it: they, and their neighbours."""

    rows: np.ndarray
    left_out: np.ndarray

    @cached_property
    def inside(self) -> np.ndarray:
        """Which of those left out are predicted."""
        return np.isin(self.left_out, self.rows)


def blocks_in_time(time: np.ndarray) -> list[Block]:
    """Cut a flight into blocks of about a second, at most a hundred of them.

    Frames within `MARGIN_S` of a block are left out with it: neighbouring frames are
    near-duplicates, and a block that kept them would flatter every model.
    """
    size = len(time)
    wanted = np.ceil((time[-1] - time[0]) / BLOCK_S)
    edges = np.linspace(0, size, int(np.clip(wanted, 2, min(100, size))) + 1).round().astype(int)
    blocks = []
    for first, last in zip(edges[:-1], edges[1:], strict=True):
        near = (time >= time[first] - MARGIN_S) & (time <= time[last - 1] + MARGIN_S)
        if near.sum() > size // 2:  # a short flight cannot spare its neighbours in time
            near[:] = False
        near[first:last] = True
        blocks.append(Block(np.arange(first, last), np.flatnonzero(near)))
    return blocks


def blocks_in_space(
    blocks: Sequence[Block], places: np.ndarray, time: np.ndarray, wanted: float
) -> list[Block]:
    """Blocks that leave out what is near in space, too, where those given keep too much.

    A later flight comes less near to the survey than another of its passes: nearest neighbour
    distance matching (Mila et al., "Nearest neighbour distance matching Leave-One-Out
    Cross-Validation for map validation", 2022).

    Parameters
    ----------
    blocks : sequence of Block
        In time; together their rows are all frames.
    places : (N, 2) array, metres
    time : (N,) array
        Seconds; rows of one frame share theirs.
    wanted : float
        Metres between a place of a later flight and the nearest frame, on average. Frames are left
        out up to the least distance that leaves the blocks' own rows as far away, and no further
        than is flown in the margin of time; a block that would lose half the flight stays as it is.
    """
    apart = cdist(places, places)
    near = np.stack([apart[block.rows].min(axis=0, initial=np.inf) for block in blocks])
    out = np.zeros(near.shape, dtype=bool)
    owner = np.empty(len(places), dtype=int)
    for number, block in enumerate(blocks):
        out[number, block.left_out], owner[block.rows] = True, number

    def short_of(distance: float) -> bool:
        gone = out | (near < distance)
        nearest = np.where(gone[owner], np.inf, apart).min(axis=1)
        return bool(nearest.mean() < wanted)

    if not short_of(0.0):
        return list(blocks)
    part = np.arange(len(time)) - np.searchsorted(time, time)  # of its frame
    ahead = (np.searchsorted(time, time + MARGIN_S) + part).clip(max=len(time) - 1)
    low, high = 0.0, float(np.median(apart[np.arange(len(time)), ahead]))
    for _ in range(HALVINGS):
        middle = (low + high) / 2
        low, high = (middle, high) if short_of(middle) else (low, middle)
    gone = out | (near < high)
    return [
        Block(block.rows, np.flatnonzero(rows)) if 2 * rows.sum() <= len(places) else block
        for block, rows in zip(blocks, gone, strict=True)
    ]


def merge_places(
    places: np.ndarray, features: np.ndarray, largest: int = MAX_PLACES
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Means of the frames in the cells of a grid just coarse enough to leave at most `largest`.

    Returns
    -------
    places : (M, 2) array
    features : (M, K) array
    counts : (M,) array
        How many frames each stands for: its noise is that much smaller.
    """
    if len(places) <= largest:
        return places, features, np.ones(len(places))
    low, extent = places.min(axis=0), np.ptp(places, axis=0).max()
    side = max(extent, 1e-9) / largest
    while True:
        x, y = np.floor((places - low) / side).astype(np.int64).T
        cells = x * (largest + 1) + y
        order = np.argsort(cells, kind="stable")
        _, starts, counts = np.unique(cells[order], return_index=True, return_counts=True)
        if len(starts) <= largest:
            break
        side *= 1.2
    places, features = (
        np.add.reduceat(each[order], starts) / counts[:, None] for each in (places, features)
    )
    return places, features, counts.astype(float)


class Process:
    """Processes of all features over one set of places, conditioned on features of mean zero.

    Parameters
    ----------
    places : (N, 2) array
    features : (N, K) array
    length : float, metres
    counts : (N,) array, optional
        As of `merge_places`.
    noise : float
        Of a frame, as a share of the signal variance.
    """

    def __init__(
        self,
        places: np.ndarray,
        features: np.ndarray,
        length: float,
        counts: np.ndarray | None = None,
        noise: float = NOISE,
    ):
        self.places, self.length, self.noise = places, length, noise
        matrix = matern(places, places, length)
        matrix[np.diag_indices(len(places))] += noise / (1 if counts is None else counts)
        self.precision = inv(matrix, assume_a="pos")
        self.weights = self.precision @ features

    def variance(self, places: np.ndarray) -> np.ndarray:
        """``(M,)`` variance at places, without noise."""
        explained = [
            np.einsum("ij,ij->i", kernel @ self.precision, kernel)
            for kernel in kernels(places, self.places, self.length)
        ]
        return np.maximum(1 - np.concatenate(explained), 0)

    def predict_without(
        self, blocks: Sequence[Block], places: Sequence[np.ndarray]
    ) -> Iterator[tuple[Block, list[tuple[np.ndarray, np.ndarray]]]]:
        """For each block mean ``(M, K)`` and variance ``(M,)`` without it at each of the sets of
        `places` ``(M, 2)``.
        """

        def everywhere(each: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
            kernel = matern(each, self.places, self.length)
            gain = kernel @ self.precision
            return gain, kernel @ self.weights, 1 - np.einsum("ij,ij->i", gain, kernel)

        known = list(ahead(everywhere, places))
        for block in blocks:
            out = block.left_out
            covariance = inv(self.precision[np.ix_(out, out)], assume_a="pos")
            found = []
            for gain, mean, variance in known:
                gone = gain[:, out]
                lost = gone @ covariance
                without = variance + np.einsum("ij,ij->i", lost, gone)
                found.append((mean - lost @ self.weights[out], np.maximum(without, 0)))
            yield block, found


def nlpd(process: Process, blocks: Sequence[Block]) -> tuple[float, np.ndarray, np.ndarray]:
    """Negative log predictive density of left-out blocks, twice that of a feature of a place and
    less a constant; ``(N, K)`` errors at each place without its block, ``(N,)`` variances with
    noise.

    Each feature's signal variance takes its likeliest value.
    """
    errors, variances = np.empty_like(process.weights), np.empty(len(process.places))
    for block in blocks:
        left_out = block.left_out
        covariance = inv(process.precision[np.ix_(left_out, left_out)], assume_a="pos")
        errors[block.rows] = (covariance @ process.weights[left_out])[block.inside]
        variances[block.rows] = np.diag(covariance)[block.inside]
    variances = np.maximum(variances, process.noise)
    scale = (np.square(errors) / variances[:, None]).mean(axis=0)
    density = float(np.log(np.maximum(scale, 1e-300)).mean() + np.log(variances).mean())
    return density, errors, variances


def select_length(
    places: np.ndarray,
    features: np.ndarray,
    blocks: Sequence[Block],
    diagonal: float,
    noises: Sequence[float] = NOISES[:1],
) -> tuple[Process, np.ndarray, np.ndarray]:
    """The process with the least `nlpd` of left-out blocks, with their residuals and variances.

    The length is chosen first, then the noise; where that is another, the length once more.
    """

    def judged(share: float, noise: float) -> tuple[Process, float, np.ndarray, np.ndarray]:
        process = Process(places, features, diagonal * share, noise=noise)
        return process, *nlpd(process, blocks)

    def best_length(noise: float) -> tuple[Process, float, np.ndarray, np.ndarray]:
        tried = ahead(lambda share: judged(share, noise), LENGTHS)
        return min(tried, key=lambda each: each[1])

    best = best_length(noises[0])
    share = best[0].length / diagonal
    quieter = (judged(share, noise) for noise in noises[1:])
    noise = min([best, *quieter], key=lambda each: each[1])[0].noise
    process, _, errors, variances = best if noise == noises[0] else best_length(noise)
    return process, errors, variances
