"""Whether a flight shows what a map's flight showed, and is not that flight again."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from trexton.base.errors import FlightError
from trexton.localization.texton_map import check_alike

if TYPE_CHECKING:
    from trexton.flights.flight import Flight
    from trexton.localization.texton_map import TextonMap

CROP_SHARE = 0.05  # of the picture, by which calibrations may cut it otherwise


def check_kind(flight: Flight, known: TextonMap | Flight) -> None:
    """Refuse a flight as `check_alike` does, also for another part of the camera's picture."""
    check_alike(flight, known)
    found, expected = (
        (0.0, 0.0, 1.0, 1.0) if how is None else np.divide(how.crop, how.source * 2).tolist()
        for how in (flight.rectification, known.rectification)
    )
    if np.abs(np.subtract(found, expected)).max() > CROP_SHARE:
        part = "{2:.0%} x {3:.0%} of the camera's picture, from {0:.0%}, {1:.0%} on"
        words = f"flight {flight.name!r} shows {part.format(*found)}, not {part.format(*expected)}"
        raise FlightError(f"{words}: import it with the same --crop")


def fingerprints(places: np.ndarray, values: np.ndarray | None) -> set[bytes]:
    """Of ``(N, 2)`` places and ``(N, K)`` values: a copy has the same, rounded too."""
    rows = places if values is None else np.hstack([places.round(2) + 0.0, values])
    return {*map(bytes, rows.astype("f4"))}
