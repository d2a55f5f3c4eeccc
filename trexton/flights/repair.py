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
from trexton.vision.time_offset import small, time_offset, turns

__all__ = ["Doubt", "count_of", "scaled", "time_offset_doubts", "view_doubts", "without_positions"]

TURNED = 0.5  # radians of yaw that other numbers would hardly look down over
OFFSET_FRAMES = 400  # whose motion is measured


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
    """Pictures that turn at another time than the yaw beside them, or the other way."""
    if not flight.has_images or flight.attitude is None:
        return
    yaw = flight.attitude[:, 2]
    rows = np.flatnonzero(np.isfinite(yaw))[:OFFSET_FRAMES]
    try:
        pictures = [small(flight.image(row)) for row in rows]
    except TrextonError:
        return  # said already
    if len({picture.shape for picture in pictures}) != 1:
        return
    time = flight.time[rows]
    found = time_offset(time, turns(pictures), time, yaw[rows])
    if found is None or not found.sure:
        return
    if found.mirrored:
        yield Doubt(
            "the pictures turn against the yaw: a yaw that is counted clockwise, or pictures that "
            "are mirrored? count it anticlockwise, as seen from above",
            "yaw counted the other way",
            lambda flight: replace(flight, attitude=np.array((1, 1, -1)) * flight.attitude),
        )
    elif found.noticeable:
        late = f"{abs(found.seconds):.2f} s {'after' if found.seconds > 0 else 'before'}"
        yield (
            f"the pictures turn {late} the yaw does: stamps of two clocks, import again with "
            f"--offset {found.seconds:.2f}"
        )
