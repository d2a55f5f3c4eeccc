"""A loop over a floor, as histograms."""

from __future__ import annotations

import numpy as np

from trexton.flights.flight import Flight


def make_flight(
    seed: int, *, informative: bool = True, scale: float = 1.0, frames: int = 120
) -> Flight:
    """A loop over a floor whose histograms follow the place, or follow nothing."""
    rng = np.random.default_rng(seed)
    angle = np.linspace(0, 6 * np.pi, frames)
    place = np.column_stack([np.cos(angle), np.sin(1.3 * angle)]) + rng.normal(0, 0.05, (frames, 2))
    seen = place if informative else rng.uniform(-1, 1, place.shape)
    centers = np.random.default_rng(9).uniform(-1.2, 1.2, (12, 2))
    values = np.exp(-((seen[:, None] - centers) ** 2).sum(axis=2) / 0.3) + 0.05
    values += rng.uniform(0, 0.02, values.shape)
    histograms = values / values.sum(axis=1, keepdims=True)
    area = tuple(scale * edge for edge in (-1.3, 1.3, -1.3, 1.3))
    return Flight(
        "loop",
        np.arange(frames),
        np.arange(frames) * 0.08,
        scale * place,
        area,
        histograms=histograms,
    )
