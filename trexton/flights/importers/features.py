"""Histograms of any feature: a table of values, a row a frame, and positions beside them or in
another table.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.options import option
from trexton.flights.importers.recording import NANO, Recording, beside
from trexton.flights.importers.table import column_names
from trexton.flights.importers.tracks import TrackColumns
from trexton.flights.tables import read_table

__all__ = ["Settings", "read", "recognises"]


@dataclass(frozen=True)
class Settings(TrackColumns):
    """What can be chosen."""

    time: str = option("", "column of the stamps (default: frames at the rate below)")
    positions: str = option(
        "", "table of x and y, a row a frame (default: columns of the same table)"
    )
    rate: float = option(12.5, "frames a second, where there are no stamps", low=0.001, high=10000)
    features: str = option("features", "what the values count; textons must sum to one")


def recognises(source: Path) -> bool:
    names = column_names(source)
    return {"x", "y"} <= names and "image" not in names and len(names) > 5


def read(source: Path, settings: Settings) -> Recording:
    """The recording of one table of features, or of two tables with a row a frame each."""
    where = beside(source.parent, settings.positions) if settings.positions else source
    places = read_table(where)
    stamps = (np.arange(len(places)) * NANO / settings.rate).astype(np.int64)
    if settings.time:
        stamps = places.nanoseconds(settings.time, settings.time_unit)
    track, said = settings.of(places, stamps=stamps)
    table = places if where == source else read_table(source)
    used = {settings.x, settings.y, settings.z, settings.time, settings.yaw, "frame", "id"}
    used |= set(settings.quaternion.split(","))
    names = [name for name in table.header if name not in (used if where == source else {"frame"})]
    if len(table) != len(places) or not names:
        raise FlightError(
            f"{source}: {len(table)} rows of {len(names)} values, {len(places)} "
            "positions: expected a row of finite numbers for each position"
        )
    return Recording(
        stamps,
        track,
        histograms=np.column_stack([table.numbers(name, missing_allowed=False) for name in names]),
        features=settings.features,
        source=f"features of {source.name}",
        said=said,
    )
