"""Where a virtual vehicle flies. Offers a survey in lanes, and random waypoints."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain, cycle

import numpy as np

Area = tuple[float, float, float, float]  # x_min, x_max, y_min, y_max in metres

__all__ = ["Plan", "survey", "random_waypoints"]

MARGIN = 0.3  # metres that plans keep from the area's edge
REACHED = 0.25  # metres from a waypoint at which the next one becomes the goal
AHEAD = 0.8  # metres that the goal runs ahead of the vehicle


class Plan:
    """A row of waypoints; the vehicle is led along the line to each until it is near."""

    def __init__(self, waypoints: Iterator[np.ndarray]):
        self._waypoints = waypoints
        self.start = self._last = next(waypoints)
        self._next = next(waypoints)

    def goal(self, position: np.ndarray) -> np.ndarray:
        """The ``(2,)`` goal for a vehicle at `position`: a point of the line, ahead of it."""
        leg = self._next - self._last
        # Two rows of lanes may share a corner.
        while np.hypot(*(self._next - position[:2])) < REACHED or not leg.any():
            self._last, self._next = self._next, next(self._waypoints)
            leg = self._next - self._last
        length = np.hypot(*leg)
        direction = leg / length
        along = np.clip((position[:2] - self._last) @ direction + AHEAD, 0, length)
        return self._last + along * direction


def _inside(area: Area) -> tuple[np.ndarray, np.ndarray]:
    x_min, x_max, y_min, y_max = area
    margin = min(MARGIN, (x_max - x_min) / 4, (y_max - y_min) / 4)
    return np.array([x_min, y_min]) + margin, np.array([x_max, y_max]) - margin


def survey(area: Area, seconds: float, speed: float) -> Iterator[np.ndarray]:
    """A diagonal, then lanes along x and along y that cover the area in about `seconds`, without
    end.

    The diagonal comes first because the dictionary is learned from the first frames (the first 100
    in the paper): they should see more than one edge of the room. Lanes both ways show the motion
    model both axes.

    Parameters
    ----------
    area : (x_min, x_max, y_min, y_max)
        Metres.
    """
    low, high = _inside(area)
    # At each corner the vehicle brakes, turns and gains speed again, which takes about a second and
    # a half.
    left = seconds - np.hypot(*(high - low)) / speed - 1.5
    lanes = int(np.clip(left / ((high - low).sum() / speed + 3), 2, 12))
    along_x, along_y = _lanes(high, low, lanes), _lanes(low[::-1], high[::-1], lanes, swap=True)
    return chain([low], cycle(chain(along_x, along_y)))


def _lanes(
    low: np.ndarray, high: np.ndarray, lanes: int, swap: bool = False
) -> Iterator[np.ndarray]:
    for number, across in enumerate(np.linspace(low[1], high[1], lanes)):
        for along in (low[0], high[0]) if number % 2 == 0 else (high[0], low[0]):
            yield np.array([across, along] if swap else [along, across])


def random_waypoints(
    area: Area, rng: np.random.Generator, apart: float = 1.0
) -> Iterator[np.ndarray]:
    """Random places without end, `apart` metres (or a third of the area) or more from the last."""
    low, high = _inside(area)
    apart = min(apart, float((high - low).min()) / 3)
    last = rng.uniform(low, high)
    while True:
        yield last
        place = rng.uniform(low, high)
        while np.hypot(*(place - last)) < apart:
            place = rng.uniform(low, high)
        last = place
