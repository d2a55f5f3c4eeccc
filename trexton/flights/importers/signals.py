"""Logs of signals: a row a reading with its stamp, source and value, and the position where it is
known. Each source, a radio beacon say, is a feature; a frame is what was heard in a bin of time.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.files import read_text
from trexton.base.options import Options, option
from trexton.flights.importers.listed import chosen_names, column_names
from trexton.flights.importers.recording import NANO, PoseTrack, Recording, nanoseconds
from trexton.flights.tables import TIMES, is_number, read_table


@dataclass(frozen=True)
class Settings(Options):
    """What can be chosen."""

    columns: str = option("stamp,source,value,x,y,z", "columns in order, if the log has no header")
    time_unit: str = option("s", "of the stamps", choices=tuple(TIMES))
    bin: float = option(0.5, "seconds of a frame", low=0.001)
    keep: float = option(3.0, "seconds for which the last value of a source holds", low=0)
    names: str = option("", "sources in order, heard or not (default: all that are heard)")
    floor: float = option(-100.0, "value of a source that is not heard")


def recognises(source: Path) -> bool:
    return {"stamp", "source", "value"} <= column_names(source)


def read(source: Path, settings: Settings) -> Recording:
    """The recording of one log: a column a source, in the order of their names."""
    time, names, value, position, said = _readings(source, settings)
    start = time.min()
    bins = np.floor((time - start) / settings.bin)
    used, index = np.unique(bins, return_inverse=True)  # a stamp may lie years from the others
    heard_of, reading = np.unique(names, return_inverse=True)
    sources = chosen_names(settings.names) or heard_of.tolist()
    columns = np.array([sources.index(name) for name in heard_of])[reading]
    total, heard = np.zeros((2, len(used), len(sources)))
    np.add.at(total, (index, columns), value)
    np.add.at(heard, (index, columns), 1)
    values = np.full(total.shape, settings.floor)
    since = np.full(len(sources), np.inf)  # seconds
    for row, gap in enumerate(settings.bin * np.diff(used, prepend=-1)):
        new = heard[row] > 0
        since = np.where(new, 0.0, since + gap)
        values[row] = np.where(since <= settings.keep, values[row - 1], settings.floor)
        values[row, new] = total[row, new] / heard[row, new]
    places = np.array([position[index == n].mean(axis=0).filled(np.nan) for n in range(len(used))])
    stamps = nanoseconds(start + settings.bin * used)
    track = PoseTrack(stamps, places) if np.isfinite(places[:, :2]).any() else None
    if len(used) == 1 < len(time):
        raise FlightError(f"{source}: {len(time)} readings in one frame: give --time-unit or --bin")
    said.insert(0, f"{source}: {len(time)} readings in {len(used)} frames")
    if silent := sorted({*sources} - {*heard_of}):
        said.append(f"never heard, always {settings.floor:g}: {', '.join(silent)}")
    if (least := value.min()) < settings.floor:
        said.append(f"not heard is {settings.floor:g}, louder than {least:g}: give a lower --floor")
    if np.median(value) < 0 <= (most := value.max()):
        said.append(f"values of {most:g} among those in dB: not heard? leave these rows out")
    name, kinds = f"log {source.name}", tuple(sources)
    return Recording(stamps, track, None, values, "signals", kinds, source=name, said=said)


def _readings(
    path: Path, settings: Settings
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, list[str]]:
    """``(R,)`` stamps in seconds, sources and values, ``(R, 3)`` positions or NaN; what to know."""
    headless = is_number(read_text(path).partition(",")[0])
    table = read_table(path, settings.columns.split(",") if headless else ())
    unknown = np.full(len(table), np.nan)
    places = [table.numbers(axis) if axis in table.header else unknown for axis in "xyz"]
    time = table.numbers("stamp") * (TIMES[settings.time_unit] / NANO)
    names, value = np.array(table.texts("source")), table.numbers("value")
    known = np.isfinite(value) & (names != "")
    good = known & (np.abs(time) < 9e9)  # later ones are in another unit
    said = [f"rows without a value, source or stamp, left out: {(~good).sum()}"] * (not good.all())
    chosen = chosen_names(settings.names)
    if others := sorted({*names[good]} - {*chosen}) if chosen else []:
        said.append(f"sources that --names leaves out: {', '.join(others)}")
        good &= np.isin(names, chosen)
    if not good.any():
        found = f"{path}: no row has a value of a source, and a stamp in {settings.time_unit}"
        raise FlightError(f"{found}: give both, or another --time-unit")
    order = np.flatnonzero(good)[np.argsort(names[good], kind="stable")]
    same = names[order][1:] == names[order][:-1]  # some logs hold one source after the other
    if (back := -np.diff(time[order])[same].min(initial=0)) > settings.keep:
        found = f"{path}: the clock is set back by {back:.3g} s"
        raise FlightError(f"{found}: import each recording by itself, rows in order of time")
    stamps = np.unique(time[good])
    gap = np.median(np.diff(stamps, prepend=stamps[0]))
    if gap > settings.keep and 2 * len(stamps) > good.sum():  # frames would hold one value each
        found = f"{path}: readings come {gap:.3g} s apart, longer than values hold"
        raise FlightError(f"{found}: give --time-unit, such as ms, or a longer --keep")
    position = np.ma.masked_invalid(np.column_stack(places)[good])
    return time[good], names[good], value[good], position, said
