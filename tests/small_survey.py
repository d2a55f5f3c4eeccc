"""A survey of twelve textons and a later flight over it, for the parts that learn a floor."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from trexton.field.tracks import TrackFilter
from trexton.localization.neighbors import Hellinger
from trexton.localization.observation import Observation
from trexton.localization.training_set import Training

AREA = (0.0, 4.0, 0.0, 3.0)


def path(count: int, start: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """A flight that covers the area, and its stamps."""
    time = start + np.arange(count) * 0.08
    x, y = 2 + 1.8 * np.sin(0.37 * time), 1.5 + 1.3 * np.sin(0.83 * time)
    return np.column_stack([x, y]), time


def look(places: np.ndarray, rng: np.random.Generator, noise: float = 0.02) -> np.ndarray:
    """Histograms of 12 textons whose shares change over about a metre."""
    turn = np.random.default_rng(5).normal(0, 1.6, (2, 12))
    shares = np.exp(
        np.sin(places @ turn + np.arange(12)) + noise * rng.normal(size=(len(places), 12))
    )
    return shares / shares.sum(axis=1, keepdims=True)


def training(count: int = 500, scale: float = 1.0, **changes) -> Training:
    rng = np.random.default_rng(2)
    places, time = path(count)
    area = tuple(scale * edge for edge in AREA)
    given = Training(
        histograms=look(places, rng),
        positions=scale * places,
        time=time,
        area=area,
        period_s=0.08,
        distance=Hellinger(),
        dictionary=None,
        flight=None,
        rng=rng,
    )
    return replace(given, **changes)


def observed(histogram: np.ndarray, samples: int | None = None) -> Observation:
    return Observation(samples=samples, histogram=lambda: histogram)


def errors_of(tracker: TrackFilter, places: np.ndarray, histograms: np.ndarray) -> np.ndarray:
    found = []
    for histogram in histograms:
        tracker.step(observed(histogram))
        found.append(tracker.estimate().position)
    return np.hypot(*(np.array(found) - places).T)
