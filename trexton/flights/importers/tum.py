"""TUM trajectories: ``stamp x y z qx qy qz qw`` in seconds and metres, beside a list of images.

Lists are read as TUM (stamp, file), UZH-FPV (id, stamp, file) and DSO (id, stamp, exposure) have
them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.options import Options, option
from trexton.flights.frames import ImageFiles
from trexton.flights.importers.axes import axes_option
from trexton.flights.importers.recording import PoseTrack, Recording
from trexton.flights.importers.tracks import TUM, trajectory_names
from trexton.flights.tables import TextTable, read_table, read_text

__all__ = ["Settings", "read", "read_trajectory", "recognises"]

_LISTS = ("rgb.txt", "images.txt", "left_images.txt", "times.txt")
_NANOSECONDS = 1e16  # stamps from here on cannot be seconds


@dataclass(frozen=True)
class Settings(Options):
    """What can be chosen."""

    images: str = option("", f"list of stamps and image files (default: {', '.join(_LISTS)})")
    trajectory: str = option("groundtruth.txt", "trajectory in the folder")
    quaternion: str = option(TUM.quaternion, "order of the last four columns")
    axes: str = axes_option()


def _list(source: Path, settings: Settings) -> Path | None:
    names = (settings.images,) if settings.images else _LISTS
    return next((source / name for name in names if (source / name).is_file()), None)


def recognises(source: Path) -> bool:
    defaults = Settings()
    return _list(source, defaults) is not None and (source / defaults.trajectory).is_file()


def read(source: Path, settings: Settings) -> Recording:
    """The recording in a folder with an image list and a trajectory."""
    listed = _list(source, settings)
    if listed is None:
        named = settings.images or ", ".join(_LISTS)
        raise FlightError(f"{source}: no list of images ({named}): name it with --images")
    table = _read_list(listed)
    stamps = table.numbers("stamp", missing_allowed=False)
    unit = "ns" if len(stamps) and np.abs(stamps).max() >= _NANOSECONDS else "s"
    track, said = read_trajectory(
        source / settings.trajectory, settings.axes, settings.quaternion, unit
    )
    return Recording(
        table.nanoseconds("stamp", unit),
        track,
        ImageFiles(tuple(source / name for name in table.texts("file"))),
        source="TUM folder",
        said=said,
    )


def _read_list(path: Path) -> TextTable:
    rows, cells = [], []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        # An id is a whole number before another number; else the stamp comes first.
        words = line.replace(",", " ").split(maxsplit=2)
        numbered = len(words) == 3 and words[0].isdigit() and _is_number(words[1])
        fields = words if numbered else ["", *line.replace(",", " ").split(maxsplit=1)]
        if len(fields) != 3:
            raise FlightError(f"{path}, row {number}: {line[:40]!r}: expected a stamp and a file")
        if _is_number(fields[2].split()[0]):  # an exposure
            found = next(path.parent.glob(f"images/{fields[0]}.*"), path.parent / fields[0])
            fields[2] = str(found.relative_to(path.parent))
        rows.append(number)
        cells.append((fields[1], fields[2].strip()))
    if not rows:
        raise FlightError(f"{path}: no rows: expected a stamp and a file a line")
    columns = dict(zip(("stamp", "file"), zip(*cells, strict=True), strict=True))
    return TextTable(path, list(columns), columns, rows, " ", ".")


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True


def read_trajectory(
    path: Path, axes: str = "auto", quaternion: str = TUM.quaternion, time_unit: str = "s"
) -> tuple[PoseTrack, list[str]]:
    """The track in a TUM file, and what to know of it, such as which `AXES` its quaternions turn.

    Raises
    ------
    FlightError
        The file cannot be read, or a row is not eight numbers.
    """
    columns = replace(TUM, axes=axes, quaternion=quaternion, time_unit=time_unit)
    return columns.of(read_table(path, trajectory_names(path, quaternion)))
