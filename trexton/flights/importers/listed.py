"""What a list of frames beside positions becomes: folders of TUM and EuRoC, tables of images or of
features. A class each, with the options and functions that an importer has.
"""

import re
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.files import read_text
from trexton.base.options import Options, option
from trexton.flights.frames import ImageFiles
from trexton.flights.importers.axes import axes_option
from trexton.flights.importers.recording import NANO, Recording, spread
from trexton.flights.importers.tracks import TUM, TrackColumns, trajectory
from trexton.flights.tables import TextTable, is_number, read_table
from trexton.vision.calibration import read_calibration

_LISTS = ("rgb.txt", "images.txt", "left_images.txt", "times.txt")
_TRACKS = ("mocap0", "vicon0", "leica0", "state_groundtruth_estimate0")
_SINCE_1970 = {"ns": 1e16, "us": 1e13, "ms": 1e11}  # stamps from here on are in no larger unit
_UNIT = r"([_ (\[]+([mun]?s|sec|m|deg|rad)[)\]]?)?$"  # with which a column's name may end
_TIMES = re.compile(rf"(?i)(t|(date|rec)?_?times?(stamps?)?|stamps?|sec(ond)?s?|clock){_UNIT}")
_COUNTERS = r"(unnamed: 0)?|(frame|row)?[_ ]?(id|no|nr|number|index|seq)|date"  # no features
_POSES = r"(pos_?)?z|height|alt(itude)?|lat(itude)?|lon(gitude)?|yaw|heading|roll|pitch|q_?[wxyz]"
_OTHERS = re.compile(rf"(?i)({_COUNTERS}|{_POSES}|v(el(ocity)?)?_?[xyz]){_UNIT}")


class Euroc:
    """EuRoC / ASL folders: ``mav0/cam0`` with ``mocap0``, ``vicon0``, ``leica0`` or a ground truth
    estimate.
    """

    @dataclass(frozen=True)
    class Settings(Options):
        """What can be chosen."""

        camera: str = option("cam0", "folder of the camera")
        track: str = option("", "folder of the positions (default: the first of its usual names)")
        axes: str = axes_option()

    @staticmethod
    def recognises(source: Path) -> bool:
        return (_mav(source) / "cam0" / "data.csv").is_file()

    @staticmethod
    def read(source: Path, settings: Settings) -> Recording:
        """The recording in an ASL folder: the folder itself, or the one that holds ``mav0``."""
        root = _mav(source)
        folder = root / settings.camera
        table = read_table(folder / "data.csv", ["stamp", "file"])
        names = [settings.track] if settings.track else list(_TRACKS)
        found = next((name for name in names if (root / name / "data.csv").is_file()), None)
        if found is None:
            raise FlightError(f"{root}: no positions in {', '.join(names)}: name their folder")
        sensor = folder / "sensor.yaml"
        camera = read_calibration(sensor)[0] if sensor.is_file() else None
        positions = read_table(root / found / "data.csv")
        if len(names := positions.header) < 4:
            raise FlightError(f"{positions.path}: {len(names)} columns: expected stamp, x, y, z")
        turn = ",".join((*names[5:8], names[4]) if len(names) >= 8 else ())  # written w, x, y, z
        time, x, y, z = names[:4]
        columns = TrackColumns(time, x, y, z, quaternion=turn, axes=settings.axes, time_unit="ns")
        track, said = columns.of(positions)
        files = ImageFiles(tuple(folder / "data" / name for name in table.texts("file")))
        name = f"ASL folder, {settings.camera} and {found}"
        said = [f"positions from {found}", *said]
        stamps = table.nanoseconds("stamp", "ns")
        return Recording(stamps, track, files, camera=camera, source=name, said=said)


def _mav(source: Path) -> Path:
    return source / "mav0" if (source / "mav0").is_dir() else source


class Tum:
    """TUM trajectories: ``stamp x y z qx qy qz qw`` in seconds and metres, beside a list of images.

    Lists are read as TUM (stamp, file), UZH-FPV (id, stamp, file) and DSO (id, stamp, exposure)
    have them.
    """

    @dataclass(frozen=True)
    class Settings(Options):
        """What can be chosen."""

        images: str = option("", f"list of stamps and image files (default: {', '.join(_LISTS)})")
        trajectory: str = option("groundtruth.txt", "trajectory in the folder")
        quaternion: str = option(TUM.quaternion, "order of the last four columns")
        axes: str = axes_option()

    @staticmethod
    def recognises(source: Path) -> bool:
        return (source / "groundtruth.txt").is_file() and _list(source, _LISTS) is not None

    @staticmethod
    def read(source: Path, settings: Settings) -> Recording:
        """The recording in a folder with an image list and a trajectory."""
        names = (settings.images,) if settings.images else _LISTS
        listed = _list(source, names)
        if listed is None:
            raise FlightError(f"{source}: none of {', '.join(names)}: name a list with --images")
        table, turn = _read_list(listed), settings.quaternion
        poses = trajectory(source / settings.trajectory, turn)
        columns = replace(TUM, axes=settings.axes, time_unit=_unit(poses), quaternion=turn)
        track, said = columns.of(poses)
        files = ImageFiles(tuple(source / name for name in table.texts("file")))
        stamps = table.nanoseconds("stamp", _unit(table))
        return Recording(stamps, track, files, source="TUM folder", said=said)


def _unit(table: TextTable) -> str:
    latest = np.abs(table.numbers("stamp", missing_allowed=False)).max()
    return next((unit for unit, least in _SINCE_1970.items() if latest >= least), "s")


def _list(source: Path, names: tuple[str, ...]) -> Path | None:
    return next((source / name for name in names if (source / name).is_file()), None)


def _read_list(path: Path) -> TextTable:
    rows, cells = [], []
    for number, line in enumerate(read_text(path).splitlines(), 1):
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        # An id is a whole number before another number; else the stamp comes first.
        words = line.replace(",", " ").split(maxsplit=2)
        numbered = len(words) == 3 and words[0].isdigit() and is_number(words[1])
        fields = words if numbered else ["", *line.replace(",", " ").split(maxsplit=1)]
        if len(fields) != 3:
            raise FlightError(f"{path}, row {number}: {line[:40]!r}: expected a stamp and a file")
        if is_number(fields[2].split()[0]):  # an exposure
            found = next(path.parent.glob(f"images/{fields[0]}.*"), path.parent / fields[0])
            fields[2] = str(found.relative_to(path.parent))
        rows.append(number)
        cells.append((fields[1], fields[2].strip()))
    if not rows:
        raise FlightError(f"{path}: no rows: expected a stamp and a file a line")
    stamps, files = zip(*cells, strict=True)
    return TextTable(path, {"stamp": stamps, "file": files}, rows)


def column_names(source: Path) -> set[str]:
    """The columns of a table; none where there is no table."""
    if source.is_file() and source.suffix.lower() in (".csv", ".tsv", ".txt"):
        with suppress(FlightError):
            return set(read_table(source).header)
    return set()


class Table:
    """A CSV of frames: stamps, positions and image files, its columns and units named."""

    @dataclass(frozen=True)
    class Settings(TrackColumns):
        """What can be chosen."""

        image: str = option("image", "column of the image files, beside the table")

    @staticmethod
    def recognises(source: Path) -> bool:
        return {"x", "y", "image"} <= column_names(source)

    @staticmethod
    def read(source: Path, settings: Settings) -> Recording:
        """The recording that a table lists."""
        table = read_table(source)
        names = np.array(table.texts(settings.image), dtype=object)
        pictured = names != ""  # the other rows are positions between the frames
        if not pictured.any():
            raise FlightError(f"{source}: no row of {settings.image!r} names an image: name them")
        stamps = settings.stamps(table, known := list[str]())
        if 1 < len(different := np.unique(stamps)) < len(stamps) / 2:
            step = int(np.diff(different).min())
            stamps = spread(stamps, step)
            known.append(f"{source}: stamps of {step / NANO:g} s, the rows of each spread over it")
        track, said = settings.of(table, stamps)
        files = ImageFiles(tuple(source.parent / name for name in names[pictured]))
        name = f"table {source.name}"
        return Recording(stamps[pictured], track, files, source=name, said=known + said)


def chosen_names(text: str) -> list[str]:
    """Names that somebody chose, separated by commas."""
    return [name for each in text.split(",") if (name := each.strip())]


class Features:
    """Histograms of any feature: a table of values, a row a frame, and positions beside them."""

    @dataclass(frozen=True)
    class Settings(TrackColumns):
        """What can be chosen."""

        time: str = option("", "column of the stamps (default: by its name, else by the rate)")
        rate: float = option(12.5, "frames a second, if there are no stamps", low=0.001, high=1e4)
        features: str = option("features", "what the values count; textons must sum to one")
        names: str = option("", "columns of the features, in order (default: all others)")

    @staticmethod
    def recognises(source: Path) -> bool:
        names = column_names(source)
        return {"x", "y"} <= names and "image" not in names and len(names) > 5

    @staticmethod
    def read(source: Path, settings: Settings) -> Recording:
        """The recording of a table of features, a row a frame."""
        table, known = read_table(source), list[str]()
        numbered = "frame" in table.header  # rows may be left out
        counted = table.numbers("frame", False) if numbered else np.arange(len(table))
        stamps = (counted * NANO / settings.rate).astype(np.int64)
        times = [name for name in table.header if _TIMES.match(name)]
        if time := settings.time or next(iter(times), ""):
            stamps = replace(settings, time=time).stamps(table, known)
            known.append(f"{source}: stamps of column {time}")
        track, said = settings.of(table, stamps)
        used = {"frame", settings.x, settings.y, settings.z, time, settings.yaw}
        used |= set(settings.quaternion.split(","))
        names = chosen_names(settings.names)
        if poses := used & set(names):
            raise FlightError(f"{source}: {', '.join(poses)} tell place or time: no features")
        if not names and (others := sorted({*times, *filter(_OTHERS.match, table.header)} - used)):
            words = f"columns {', '.join(others)} are no features by their names, left out"
            known.append(f"{source}: {words}: name them with --time, --z or --yaw")
            used |= set(others)
        names = names or [name for name in table.header if name not in used]
        if not names:
            raise FlightError(f"{source}: no column of values beside the positions: add some")
        rows = np.column_stack([table.numbers(name, missing_allowed=False) for name in names])
        name, said = f"features of {source.name}", said + known
        kind, named = settings.features, tuple(names)
        return Recording(stamps, track, None, rows, kind, named, source=name, said=said)
