"""What is doubted of a flight, and how it is mended: `Doubt`, and the mends that several share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from trexton.flights.flight import Flight

__all__ = ["Doubt", "scaled", "without_positions"]


class Doubt(str):
    """A sentence; `mend` does what it advises, where that can be done, and `done` says so."""

    mend: Callable[[Flight], Flight] | None
    done: str

    def __new__(
        cls, text: str, done: str = "", mend: Callable[[Flight], Flight] | None = None
    ) -> Doubt:
        made = super().__new__(cls, text)
        made.mend, made.done = mend, done
        return made


def scaled(factor: float, *columns: str) -> Callable[[Flight], Flight]:
    """Multiplies columns, and the area with the positions where it is their own."""

    def mend(flight: Flight) -> Flight:
        changes: dict[str, Any] = {
            name: factor * np.array(getattr(flight, name)) for name in columns
        }
        return replace(flight, **changes)

    return mend


def without_positions(rows: np.ndarray) -> Callable[[Flight], Flight]:
    """Leaves the positions of these rows empty, and the area without them where it was theirs."""

    def mend(flight: Flight) -> Flight:
        position = flight.position.copy()
        position[rows] = np.nan
        known, left = flight.position[flight.located], position[np.isfinite(position[:, 0])]
        area = np.array(flight.area).reshape(2, 2)
        low, high = left.min(axis=0), left.max(axis=0)
        margin = 0.02 * (high - low) + 0.01
        slack = 0.05 * flight.diagonal
        drawn = np.abs(area[:, 0] - known.min(axis=0)) + np.abs(area[:, 1] - known.max(axis=0))
        if (drawn < slack).all():  # it was drawn around the positions
            area = np.column_stack([low - margin, high + margin])
        height = None if flight.height is None else flight.height.copy()
        if height is not None:
            height[rows] = np.nan
        x_min, x_max, y_min, y_max = area.ravel().tolist()
        return replace(flight, position=position, height=height, area=(x_min, x_max, y_min, y_max))

    return mend
