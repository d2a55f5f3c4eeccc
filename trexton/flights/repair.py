"""What is doubted of a flight, and how it is mended: `Doubt`, and the mends that several share.

`view_doubts` and `time_offset_doubts` say whether its camera looks down, and is of one clock with
the poses.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from trexton.base.errors import TrextonError
from trexton.flights.flight import Flight, area_around
from trexton.flights.importers.axes import (
    AXES,
    TAKEN,
    looks_away,
    quaternions_from_attitude,
    readings,
)
from trexton.flights.importers.recording import NANO, PoseTrack, match
from trexton.vision.time_offset import moves, small, speed_correlations, time_offset, turns

__all__ = [
    "Doubt", "count_of", "scaled", "time_offset_doubts", "view_doubts", "with_poses_of",
    "without_positions",
]  # fmt: skip

TURNED = 0.5  # radians of yaw that other numbers would hardly look down over
OFFSET_FRAMES = 400  # whose motion is measured
FEWEST_MOVED = 60  # of them with a place, for an offset by speed
ALIKE, CLEARER = 0.6, 0.15  # correlation of speeds that is believed, and above that of others
CLEAR_S, MOST_LATE = 0.6, 2.0  # seconds from the best offset to others, and that it may have


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


def view_doubts(flight: Flight) -> Iterator[str]:
    """A camera that does not look down in half of the frames."""
    if flight.attitude is None or not (doubt := looks_away(flight.attitude)):
        return
    # As the import that wrote them took them; else they are taken for what they should be.
    noted = (note.removeprefix(TAKEN) for note in flight.notes if note.startswith(TAKEN))
    taken = AXES.get(next(noted, ""), AXES["rfu"])
    words, better = next(readings(quaternions_from_attitude(flight.attitude, taken)), ("", None))
    if better is None:
        yield doubt
        return
    # Of a vehicle that does not turn, another order of its numbers looks down by chance.
    sure = "order" not in words or np.ptp(np.unwrap(better[np.isfinite(better[:, 2]), 2])) > TURNED
    yield Doubt(
        f"{doubt} ({words} would look down)",
        f"attitudes read as of {words} (where the nose then points aside, import with --axes)",
        (lambda flight: replace(flight, attitude=better)) if sure else None,
    )


def time_offset_doubts(flight: Flight) -> Iterator[str]:
    """Pictures that turn or move at another time than the poses beside them, or turn the other
    way.
    """
    if not flight.has_images:
        return
    yaw = np.full(len(flight), np.nan) if flight.attitude is None else flight.attitude[:, 2]
    rows = np.flatnonzero(flight.located | np.isfinite(yaw))[:OFFSET_FRAMES]
    try:
        pictures = [small(flight.image(row)) for row in rows]
    except TrextonError:
        return  # said already
    if len({picture.shape for picture in pictures}) != 1:
        return
    time = flight.time[rows]
    known = np.isfinite(yaw[rows])
    found = time_offset(time, turns(pictures), time[known], yaw[rows][known])
    if found is not None and found.sure and found.mirrored:
        yield Doubt(
            "the pictures turn against the yaw: a yaw that is counted clockwise, or pictures that "
            "are mirrored? count it anticlockwise, as seen from above",
            "yaw counted the other way",
            lambda flight: replace(flight, attitude=np.array((1, 1, -1)) * flight.attitude),
        )
        return
    if found is not None and found.sure:
        what, seconds = "turn {} the yaw does", found.seconds if found.noticeable else 0.0
    else:
        what, seconds = "move {} the positions do", _by_speed(flight, rows, pictures)
    if seconds:
        late = f"{abs(seconds):.2f} s {'after' if seconds > 0 else 'before'}"
        yield Doubt(
            f"the pictures {what.format(late)}: their stamps and those of attitude and position "
            "are not of one clock: shift the one by that",
            f"poses shifted, as the pictures {what.format(late)}",
            lambda flight: with_poses_of(flight, seconds),
        )


def _by_speed(flight: Flight, rows: np.ndarray, pictures: list[np.ndarray]) -> float:
    """Seconds by which pictures move after the vehicle does, 0 where that is not sure."""
    located = flight.located[rows]
    time = flight.time[rows]
    if located.sum() < FEWEST_MOVED or not 4 * MOST_LATE < np.ptp(time) < 1e4:
        return 0.0
    height = np.ones(len(rows)) if flight.height is None else flight.height[rows]
    motion = moves(pictures) * np.nan_to_num(height, nan=1.0) / np.diff(time, prepend=time[0] - 1)
    offsets, alike = speed_correlations(time, motion, time[located], flight.position[rows[located]])
    best = int(alike.argmax())
    others = np.abs(offsets - offsets[best]) > CLEAR_S
    now = float(np.interp(0, offsets, alike))
    sure = alike[best] > ALIKE and max(now, alike[others].max(initial=-1)) < alike[best] - CLEARER
    return -float(offsets[best]) if sure and abs(offsets[best]) <= MOST_LATE else 0.0
