"""Files of positions: JSON lines (with events, the log), a CSV table, a TUM trajectory.

All write whole lines by `FileSink`, into a file that grows while the vehicle flies, or onto
standard output. Whoever derives from it says in `write` which line a fix is.
"""

import errno
import json
import os
import select
import stat
import sys
from contextlib import suppress
from typing import Any, ClassVar, Self

import numpy as np

from trexton.base.errors import ParameterError
from trexton.base.records import plain
from trexton.onboard.fix import Fix
from trexton.onboard.sinks import Sink, Surroundings

COLUMNS = (
    "time_s", "frame", "x_m", "y_m", "std_x_m", "std_y_m",
    "observed", "lost", "stale", "resets", "latency_s", "fault", "heading_rad", "heading_std_rad",
)  # fmt: skip
_UPPER = np.triu_indices(2)  # xx, xy and yy of a covariance
_ADDING = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NONBLOCK  # no wait for a pipe's reader


def _move_aside(path: str) -> None:
    if not os.path.isfile(path) or not os.path.getsize(path):
        return
    number = 1
    while os.path.lexists(f"{path}.{number}"):
        number += 1
    os.rename(path, f"{path}.{number}")


class FileSink(Sink):
    """A file that takes whole lines, each with one system call, so that neither a crash nor a full
    disk leaves half a line behind.

    What the file holds already is moved to the first free of ``path.1``, ``path.2`` and so on: a
    flight's positions are flown only once. A flight that is refused before has touched nothing.

    Parameters
    ----------
    path : str
        ``-`` for standard output.

    Raises
    ------
    ParameterError
        The file cannot be made at all.
    """

    chosen: Any = None  # of its class of options
    header: ClassVar[str] = ""  # first line of a new file

    def __init__(self, path: str):
        self.name = self.file = path
        self._opened: Any = None  # its descriptor, while it is open
        self._fresh, self._standard = True, path == "-"
        if not self._standard:
            there = os.path.exists(path)
            try:
                os.close(os.open(path, _ADDING, 0o644))
            except OSError as error:
                raise ParameterError(
                    f"{path}: cannot be written ({error.strerror}): "
                    "give a file in a folder that exists"
                ) from None
            if not there:
                os.unlink(os.path.realpath(path))

    @classmethod
    def make(cls, address: str, options: Any, around: Surroundings) -> Self:
        """The sink of an address ``KIND:FILE``, or ``KIND`` for standard output."""
        made = cls(address or "-")
        made.name, made.chosen = f"{around.kind}:{made.file}", options
        return made

    def open(self) -> None:
        """Open for adding; the header goes in where the file is still empty."""
        if self._standard:
            if sys.stdout is None:
                raise OSError(errno.EBADF, "there is no standard output")
            self._opened = os.dup(sys.stdout.fileno())
        else:
            if self._fresh:
                with suppress(PermissionError):  # in a folder of others it is added to
                    _move_aside(os.path.realpath(self.file))
            self._fresh = False
            self._opened = os.open(self.file, _ADDING, 0o644)
        self._regular = stat.S_ISREG(os.fstat(self._opened).st_mode)
        if self.header and (self._standard or os.fstat(self._opened).st_size == 0):
            self._add(self.header)

    def add(self, line: str) -> None:
        """Add one line.

        Raises
        ------
        OSError
            The disk is full, the file was deleted or moved, or the reader of a pipe is too slow:
            an error, not a wait.
        """
        if self._regular and not self._standard:
            there = os.path.exists(self.file)
            if not (there and os.path.samestat(os.stat(self.file), os.fstat(self._opened))):
                raise OSError(errno.ENOENT, "the file was deleted or moved; a new one is begun")
        self._add(line)

    def _add(self, line: str) -> None:
        if not select.select([], [self._opened], [], 0)[1]:
            raise BlockingIOError(errno.EAGAIN, "its reader is too slow")
        data = (line + "\n").encode()
        size = os.fstat(self._opened).st_size
        written = os.write(self._opened, data)
        if written < len(data):
            if self._regular:
                os.ftruncate(self._opened, size)  # half a line never, nor a gap in its place
                os.lseek(self._opened, size, os.SEEK_SET)
            raise OSError(errno.ENOSPC, "the disk is full: a line was left out")

    def close(self) -> None:
        """Close; the file can be opened again."""
        if self._opened is not None:
            os.close(self._opened)
            self._opened = None


def row(fix: Fix) -> dict[str, Any]:
    """A fix as JSON values: what is not finite becomes null."""
    fusion = fix.fusion
    values: Any = plain(
        {
            "time_s": fix.time, "frame": fix.number,
            "x_m": fix.position[0], "y_m": fix.position[1],
            "std_x_m": fix.spread[0], "std_y_m": fix.spread[1],
            "covariance_m2": fix.covariance[_UPPER],
            "observed": fix.observed, "lost": fix.lost, "stale": fix.stale, "resets": fix.resets,
            "latency_s": fix.latency, "fault": fix.fault,
            "measurement_m": fusion.position,
            "measurement_covariance_m2": fusion.covariance[_UPPER],
            "heading_rad": fix.heading, "heading_std_rad": fix.heading_sigma,
        }
    )  # fmt: skip
    return dict(values)


class JsonLines(FileSink):
    """Fixes as JSON lines; with `events` it is a log: events are lines as well."""

    addresses = {
        "json": "one object a line on standard output, as csv and tum without a file; the default",
        "json:FILE": "the same in a file",
    }

    def __init__(self, path: str, events: bool = False):
        super().__init__(path)
        self._events = events

    def write(self, fix: Fix) -> None:
        self.add(json.dumps(row(fix), allow_nan=False))

    def event(self, event: dict[str, Any]) -> None:
        if self._events:
            self.add(json.dumps(plain(event), allow_nan=False))


class CsvTable(FileSink):
    """Fixes as rows under `COLUMNS`; flags are 0 or 1, cells of what is not finite stay empty."""

    addresses = {"csv:FILE": "a table, a row a frame, numbered as the flight numbers it"}
    header = ",".join(COLUMNS)

    def write(self, fix: Fix) -> None:
        values = row(fix)
        cells = [int(each) if isinstance(each, bool) else each for each in map(values.get, COLUMNS)]
        self.add(",".join("" if cell is None else str(cell) for cell in cells))


class TumTrajectory(FileSink):
    """``time x y z qx qy qz qw``: observed fixes that a vehicle may steer by, in the map's axes.

    Nothing measures height, roll or pitch, which are 0. The quaternion turns the axis of the nose
    from the map's x to the heading; it is 0 0 0 1 where the frame does not show the heading.
    """

    addresses = {"tum:FILE": "a trajectory for `evo` and its like, of positions fit to steer by"}

    def write(self, fix: Fix) -> None:
        if fix.usable and fix.observed:
            x, y = fix.position
            turn = "0 1"
            if fix.heading is not None:
                half = (fix.heading + np.pi / 2) / 2
                turn = f"{np.sin(half):.6f} {np.cos(half):.6f}"
            self.add(f"{fix.time:.6f} {x:.6f} {y:.6f} 0 0 0 {turn}")
