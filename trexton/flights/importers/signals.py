"""Logs of signals: a row a reading with its stamp, source and value, and the position where it is
known. Each source, a radio beacon say, is a feature; a frame is what was heard in a bin of time.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.files import read_text
from trexton.base.options import Options, option
from trexton.flights.importers.listed import column_names
from trexton.flights.importers.recording import PoseTrack, Recording, nanoseconds
from trexton.flights.tables import is_number, read_table


@dataclass(frozen=True)
class Settings(Options):
    """What can be chosen."""

    columns: str = option("stamp,source,value,x,y,z", "columns in order, if the log has no header")
    bin: float = option(0.5, "seconds of a frame", low=0.001)
    keep: float = option(3.0, "seconds for which the last value of a source holds", low=0)
    floor: float = option(-100.0, "value of a source that is not heard")


@dataclass(frozen=True, eq=False)
class Log:
    """Readings: ``(R,)`` stamps in seconds, sources and values, ``(R, 3)`` positions or NaN."""

    time: np.ndarray
    source: np.ndarray
    value: np.ndarray
    position: np.ndarray

    @classmethod
    def of(cls, path: Path, columns: str) -> Log:
        """With these columns where the log has no header."""
        headless = is_number(read_text(path).partition(",")[0])
        table = read_table(path, columns.split(",") if headless else ())
        unknown = np.full(len(table), np.nan)
        places = [table.numbers(axis) if axis in table.header else unknown for axis in "xyz"]
        position = np.column_stack(places)
        time, value = table.numbers("stamp"), table.numbers("value")
        good = (np.abs(time) < 9e9) & np.isfinite(value)  # later ones are not in seconds
        if not good.any():
            raise FlightError(f"{path}: no row has a value, and a stamp in seconds: give both")
        return cls(time[good], np.array(table.texts("source"))[good], value[good], position[good])


def frames_of(
    log: Log, sources: np.ndarray, settings: Settings
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each bin with a reading: ``(N,)`` seconds, ``(N, K)`` values, ``(N, 3)`` positions."""
    start = log.time.min()
    bins = np.floor((log.time - start) / settings.bin)
    used, index = np.unique(bins, return_inverse=True)  # a stamp may lie years from the others
    columns = np.searchsorted(sources, log.source)
    total, heard = np.zeros((2, len(used), len(sources)))
    np.add.at(total, (index, columns), log.value)
    np.add.at(heard, (index, columns), 1)
    values = np.full(total.shape, settings.floor)
    since = np.full(len(sources), np.inf)  # seconds
    for row, gap in enumerate(settings.bin * np.diff(used, prepend=-1)):
        new = heard[row] > 0
        since = np.where(new, 0.0, since + gap)
        values[row] = np.where(since <= settings.keep, values[row - 1], settings.floor)
        values[row, new] = total[row, new] / heard[row, new]
    places = np.array([log.position[index == row].mean(axis=0) for row in range(len(used))])
    return start + settings.bin * used, values, places


def recognises(source: Path) -> bool:
    return {"stamp", "source", "value"} <= column_names(source)


def read(source: Path, settings: Settings) -> Recording:
    """The recording of one log."""
    log = Log.of(source, settings.columns)
    time, values, places = frames_of(log, np.unique(log.source), settings)
    stamps = nanoseconds(time)
    track = PoseTrack(stamps, places) if np.isfinite(places[:, :2]).any() else None
    name, said = f"log {source.name}", f"{source}: {len(log.time)} readings in {len(time)} frames"
    return Recording(stamps, track, histograms=values, features="signals", source=name, said=[said])
