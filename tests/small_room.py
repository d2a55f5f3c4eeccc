"""A small room and two flights over it, for experiments that must run in a second."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import cv2
import numpy as np

from trexton.flights.flight import Flight
from trexton.flights.frames import ImageFiles
from trexton.localization.measurement import RankMixture
from trexton.localization.motion import RandomWalk
from trexton.localization.neighbors import Neighbors
from trexton.localization.observation import Observation

SIDE = 240  # pixels of the floor's picture
METRES = 4.0
SHAPE = (36, 48)


def lanes(frames: int, turns: float) -> np.ndarray:
    """``(frames, 2)`` metres: to and fro over the room."""
    phase = np.linspace(0, 1, frames)
    across = np.abs((phase * turns * 2) % 2 - 1)
    return np.column_stack([0.5 + 3.0 * across, 0.5 + 3.0 * phase])


def picture_flight(
    folder: Path, name: str, frames: int = 48, turns: float = 3.0, floor: bool = True
) -> Flight:
    """Frames cut from a floor of coloured blobs; a quarter of a second apart."""
    folder.mkdir(parents=True, exist_ok=True)
    rng = np.random.default_rng(11)
    blobs = rng.integers(0, 256, (12, 12, 3), dtype=np.uint8)
    picture = cv2.resize(blobs, (SIDE, SIDE), interpolation=cv2.INTER_CUBIC)
    cv2.imwrite(str(folder / "floor.png"), picture)
    scale = SIDE / METRES
    position = lanes(frames, turns)
    files = []
    for number, (x, y) in enumerate(position):
        column, row = int(x * scale) - SHAPE[1] // 2, int((METRES - y) * scale) - SHAPE[0] // 2
        files.append(folder / f"{number:04d}.png")
        cut = picture[
            max(row, 0) : max(row, 0) + SHAPE[0], max(column, 0) : max(column, 0) + SHAPE[1]
        ]
        cv2.imwrite(str(files[-1]), cv2.resize(cut, SHAPE[::-1]))
    step = 1 / scale
    return Flight(
        name=name,
        frame=np.arange(100, 100 + frames),
        time=np.arange(frames) * 0.25,
        position=position,
        area=(0.0, METRES, 0.0, METRES),
        frames=ImageFiles(tuple(files)),
        floor_file=folder / "floor.png" if floor else None,
        floor_from_pixel=np.array([[step, 0, step / 2], [0, -step, METRES - step / 2], [0, 0, 1]])
        if floor
        else None,
    )


def histogram_flight(name: str, frames: int = 60, turns: float = 3.0, noise: int = 1) -> Flight:
    """Histograms of five textons that change smoothly with the place; a quarter of a second
    apart.
    """
    rng = np.random.default_rng(noise)
    position = lanes(frames, turns) + rng.normal(
        scale=0.02, size=(frames, 2)
    )  # no two distances alike
    x, y = position.T
    histograms = np.stack(
        [np.sin(x) ** 2, np.cos(y) ** 2, np.sin(x + y) ** 2, np.full(frames, 0.5), 0.2 * x], axis=1
    )
    histograms += rng.uniform(0, 0.1, histograms.shape)
    return Flight(
        name=name,
        frame=np.arange(frames),
        time=np.arange(frames) * 0.25,
        position=position,
        area=(0.0, METRES, 0.0, METRES),
        histograms=histograms / histograms.sum(axis=1, keepdims=True),
    )


def observations(positions: np.ndarray) -> list[Observation]:
    """Observations whose neighbours lie at these ``(N, k, 2)`` positions; as if a search had
    given them.
    """
    nothing = np.zeros(1)
    made = []
    for places in positions:
        index = np.arange(len(places))
        neighbors = Neighbors(index, index.astype(float), places)
        made.append(Observation(histogram=nothing.copy, neighbors=partial(_always, neighbors)))
    return made


def _always(neighbors: Neighbors, histogram: np.ndarray) -> Neighbors:
    return neighbors


def random_walk(covariance: np.ndarray, period_s: float = 1.0) -> RandomWalk:
    """The walk of a given ``(2, 2)`` covariance from frame to frame, square metres."""
    return RandomWalk().with_learned(covariance=covariance, period_s=np.asarray(period_s))


def rank_mixture(covariances: np.ndarray) -> RankMixture:
    """The mixture of given ``(k, 2, 2)`` covariances, best rank first, square metres."""
    return RankMixture(max(1, len(covariances))).with_learned(covariances=covariances)
