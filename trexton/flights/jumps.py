"""Heights and yaws that jump and come back while the vehicle flies on. `jump_doubts` names them."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from trexton.flights.flight import Flight
from trexton.flights.importers.axes import MAX_ANGLE
from trexton.flights.tracking import FEWEST, SMALLEST, Doubt, count_of, longest_chain, ranges

NOISE = 8.0  # times the usual step: noise does not go so far
MOST = 0.15  # of the rows: where more jump it is the flight
CLIMB, CLIMBS = 0.25, 2.5  # of the usual height, and metres a second, that are no jump
TURN, TURNS = 0.5, 4.0  # radians, and radians a second


def jump_doubts(flight: Flight) -> Iterator[str]:
    """What jumps in a flight, in words."""
    found: list[tuple[str, str, np.ndarray]] = []
    if (height := flight.height) is not None and np.isfinite(height).any():
        least, columns = CLIMB * float(np.nanmedian(np.abs(height))), [height, 0 * height]
        rows = _strays(flight.time, np.column_stack(columns), least, CLIMBS)
        found.append(("height", "height", rows))
    if (angles := flight.attitude) is not None and not (np.abs(angles) > MAX_ANGLE).any():
        turned = np.column_stack([np.cos(angles[:, 2]), np.sin(angles[:, 2])])
        found.append(("yaw", "attitude", _strays(flight.time, turned, TURN, TURNS)))
    for what, column, rows in found:
        if len(rows):
            frames = f"(frames {ranges(flight.frame[rows])})"
            said = f"{count_of(len(rows), what)} jumped to and back from {frames}"
            advice = f"was a sensor wrong? leave the {column} of these frames empty"
            known: Any = getattr(flight, column).copy()
            known[rows] = np.nan
            mend = partial(replace, **{column: known})
            yield Doubt(f"{said}: {advice}", f"{said}, left empty", mend)


def _strays(time: np.ndarray, values: np.ndarray, least: float, fastest: float) -> np.ndarray:
    """The rows of ``(N, 2)`` values without which the others follow one another without a jump."""
    rows = np.flatnonzero(np.isfinite(values).all(axis=1))
    if len(rows) < FEWEST or not least > 0:
        return rows[:0]
    steps = np.hypot(*np.diff(values[rows], axis=0).T)
    scale = SMALLEST / max(least, NOISE * float(np.median(steps)))
    strays = np.delete(rows, longest_chain(time[rows], scale * values[rows], scale * fastest))
    return strays if len(strays) <= MOST * len(rows) else rows[:0]
