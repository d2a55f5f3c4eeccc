"""What is doubted of a flight, and how it is mended: `Doubt`, and the mends that several share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from trexton.flights.flight import Flight, area_around
from trexton.flights.importers.recording import NANO, PoseTrack, match

__all__ = ["Doubt", "count_of", "scaled", "with_poses_of", "without_positions"]


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
        area, theirs = flight.area, np.array(area_around(flight.position))
        if (np.abs(theirs - area) < 0.05 * flight.diagonal).all():  # it was drawn around them
            area = area_around(position, 0.02, 0.01)
        height = None if flight.height is None else flight.height.copy()
        if height is not None:
            height[rows] = np.nan
        return replace(flight, position=position, height=height, area=area)

    return mend


def with_poses_of(flight: Flight, seconds: float) -> Flight:
    """The flight with the poses of so many seconds before each stamp; empty where none is."""
    unknown = np.full(len(flight), np.nan)
    height = unknown if flight.height is None else flight.height
    stamps = np.rint((flight.time - flight.time[0]) * NANO).astype(np.int64)
    track = PoseTrack(stamps, np.column_stack([flight.position, height]), flight.attitude)
    between = max(0.1, float(np.median(np.diff(flight.time))))
    placed, _ = match(stamps, track.shifted(seconds), between)
    return replace(
        flight,
        position=placed.position[:, :2],
        height=None if flight.height is None else placed.position[:, 2],
        attitude=placed.attitude,
    )


def count_of(number: int, what: str) -> str:
    """``3 frames``, ``1 frame``, ``no frames``."""
    return f"{number or 'no'} {what}{'' if number == 1 else 's'}"
