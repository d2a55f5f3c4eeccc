"""Heights and yaws that jump and come back while the vehicle flies on (`jump_doubts`), and features
that do not change with it (`feature_doubts`)."""

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
HELD, COUNTED = 0.2, 30  # of the area, flown at one value; frames through which a counter counts
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


def feature_doubts(flight: Flight) -> Iterator[str]:
    """Histograms that repeat while the vehicle flies on, and features that only count."""
    if len(flight) < 3 or (values := flight.histograms) is None:
        return
    steps, moved = np.diff(values, axis=0), np.hypot(*np.diff(flight.position, axis=0).T)
    same, counts = ~steps.any(axis=1), (steps > 0).all(axis=0) | (steps < 0).all(axis=0)
    if same.all():
        yield "all histograms are the same: no frame can be told from another"
    elif np.nansum(moved[same]) > HELD * flight.diagonal:
        held = f"from frame {flight.frame[1:][same][0]} on {same.sum()} histograms repeat the last"
        yield f"{held} while the vehicle flew on: did the sensor stand still? leave them out"
    if counts.any() and len(flight) >= COUNTED:
        place = int(counts.argmax())
        name = (flight.feature_names[place] if flight.feature_names else "") or place
        yield f"feature {name} only rises or falls: a clock or a counter? leave it out"


def _strays(time: np.ndarray, values: np.ndarray, least: float, fastest: float) -> np.ndarray:
    """The rows of ``(N, 2)`` values without which the others follow one another without a jump."""
    rows = np.flatnonzero(np.isfinite(values).all(axis=1))
    if len(rows) < FEWEST or not least > 0:
        return rows[:0]
    steps = np.hypot(*np.diff(values[rows], axis=0).T)
    scale = SMALLEST / max(least, NOISE * float(np.median(steps)))
    strays = np.delete(rows, longest_chain(time[rows], scale * values[rows], scale * fastest))
    return strays if len(strays) <= MOST * len(rows) else rows[:0]
