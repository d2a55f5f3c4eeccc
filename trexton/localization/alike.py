"""Whether a flight shows what a map's flight showed, and is not that flight again."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from trexton.base.errors import FlightError
from trexton.localization.texton_map import TextonMap
from trexton.vision.histograms import SUM_TOLERANCE

if TYPE_CHECKING:
    from trexton.flights.flight import Flight

CROP_SHARE = 0.05  # of the picture, by which calibrations may cut it otherwise


def check_kind(flight: Flight, known: TextonMap | Flight) -> None:
    """Refuse a flight whose images or features are not of the kind of a map's, or of another
    flight's, as far as that is known, or that shows another part of the camera's picture, by a
    `FlightError`.
    """
    found, expected = _frames(flight), _frames(known)
    pairs = enumerate(zip(flight.feature_names, known.feature_names, strict=False), 1)
    odd = next((place for place, (name, first) in pairs if name != first), None)
    if found == expected and odd is not None:
        found, expected = (f"feature {odd} {x.feature_names[odd - 1]!r}" for x in (flight, known))
    if found != expected:
        words = f"flight {flight.name!r} has {found} where {expected} were expected"
        raise FlightError(f"{words}: import it as the first was, with the same --names if any")
    shown, other = (
        (0.0, 0.0, 1.0, 1.0) if how is None else np.divide(how.crop, how.source * 2).tolist()
        for how in (flight.rectification, known.rectification)
    )
    if np.abs(np.subtract(shown, other)).max() > CROP_SHARE:
        part = "{2:.0%} x {3:.0%} of the camera's picture, from {0:.0%}, {1:.0%} on"
        words = f"flight {flight.name!r} shows {part.format(*shown)}, not {part.format(*other)}"
        raise FlightError(f"{words}: import it with the same --crop")


def _frames(known: TextonMap | Flight) -> str:
    """What the frames of a map or a flight are, in words."""
    if isinstance(known, TextonMap):
        shape = known.image_shape
    else:
        shape = known.image(0).shape[:2] if known.has_images else None
    if shape is None:
        return f"{0 if known.histograms is None else known.histograms.shape[1]} features a frame"
    lens = "undistorted " * bool(known.rectification and known.rectification.distortion)
    return f"{lens}images of {shape[1]}x{shape[0]} pixels"


def are_shares(histograms: np.ndarray) -> bool:
    """Whether ``(N, K)`` histograms are relative frequencies, not counts or other features."""
    some = histograms[histograms.any(axis=1)]  # in an empty frame nothing was found to count
    sums = np.abs(some.sum(axis=1) - 1) <= SUM_TOLERANCE
    return bool(len(some) and sums.all() and (some >= 0).all())


def fingerprints(places: np.ndarray, values: np.ndarray | None) -> set[bytes]:
    """Of ``(N, 2)`` places and ``(N, K)`` values: a copy has the same, rounded too."""
    rows = places if values is None else np.hstack([places.round(2) + 0.0, values])
    return {*map(bytes, rows.astype("f4"))}
