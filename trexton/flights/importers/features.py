"""Histograms of any feature: a table of values, a row a frame, and positions beside them or in
another table.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.options import Options, option
from trexton.flights.importers import table as tables
from trexton.flights.importers.recording import NANO, Recording, Track, beside
from trexton.flights.tables import column, read_table

__all__ = ["Settings", "read", "recognises"]


@dataclass(frozen=True)
class Settings(Options):
    """What can be chosen."""

    positions: str = option(
        "", "table of x and y, a row a frame (default: columns of the same table)"
    )
    x: str = option("x", "column of x")
    y: str = option("y", "column of y")
    time: str = option("", "column of the stamps (default: frames at the rate below)")
    rate: float = option(12.5, "frames a second, where there are no stamps", low=0.001, high=10000)
    unit: str = option("m", "unit of the positions", choices=tuple(tables.LENGTHS))
    features: str = option("features", "what the values count; textons must sum to one")


def recognises(source: Path) -> bool:
    if not (source.is_file() and source.suffix.lower() in (".csv", ".tsv", ".txt")):
        return False
    try:
        names = set(read_table(source).columns)
    except FlightError:
        return False
    return {"x", "y"} <= names and "image" not in names and len(names) > 5


def read(source: Path, settings: Settings) -> Recording:
    """The recording of one table of features, or of two tables with a row a frame each."""
    import pandas as pd

    where = beside(source.parent, settings.positions) if settings.positions else source
    places = read_table(where)
    place = np.column_stack([column(where, places, name) for name in (settings.x, settings.y)])
    scale = tables.LENGTHS[settings.unit]
    if settings.time:
        stamps = tables.nanoseconds(column(where, places, settings.time).to_numpy(), "s")
    else:
        stamps = (np.arange(len(places)) * NANO / settings.rate).astype(np.int64)
    table = places if where == source else read_table(source)
    used = {settings.x, settings.y, settings.time, "frame", "id"} if where == source else {"frame"}
    values = table[[name for name in table.columns if name not in used]]
    try:
        numbers = values.apply(pd.to_numeric, errors="coerce").to_numpy(dtype=float)
    except OverflowError:
        raise FlightError(f"{source}: a value is a whole number beyond all others") from None
    if len(numbers) != len(places) or not numbers.shape[1] or not np.isfinite(numbers).all():
        raise FlightError(
            f"{source}: {numbers.shape[0]} rows of {numbers.shape[1]} values, {len(places)} "
            "positions: expected a row of finite numbers for each position"
        )
    height = np.full((len(place), 1), np.nan)
    return Recording(
        stamps,
        Track(stamps, np.hstack([scale * place, height])),
        histograms=numbers,
        features=settings.features,
        source=f"features of {source.name}",
    )
