"""Blocks of a flight for leave-neighbours-out cross-validation, in time and in space.

Frames near a left-out one in time show nearly the same; so do those of another pass over the same
place. A later flight comes less near to the survey, and errs more than blocks that were left out
in time alone would say. They leave out what is near in space as well, until the frames left are as
far away as a later flight will find them: nearest neighbour distance matching (Mila et al.,
"Nearest neighbour distance matching Leave-One-Out Cross-Validation for map validation", 2022), by
the mean.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.distance import cdist

__all__ = ["Block", "blocks_in_space", "blocks_in_time"]

BLOCK_S = 1.0
MARGIN_S = 0.5
HALVINGS = 8  # of the margin, until the distance in space is near enough


@dataclass(frozen=True, eq=False)
class Block:
    """Rows that are predicted, and those left out for it: they, and their neighbours."""

    rows: np.ndarray
    left_out: np.ndarray


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
        near[first:last] = True
        if near.sum() > size // 2:  # a short flight cannot spare its neighbours in time
            near[:] = False
            near[first:last] = True
        blocks.append(Block(np.arange(first, last), np.flatnonzero(near)))
    return blocks


def blocks_in_space(
    blocks: Sequence[Block], places: np.ndarray, time: np.ndarray, wanted: float
) -> list[Block]:
    """Blocks that leave out what is near in space, too, where those given keep too much.

    Parameters
    ----------
    blocks : sequence of Block
        In time; together their rows are all frames.
    places : (N, 2) array
        Metres.
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
