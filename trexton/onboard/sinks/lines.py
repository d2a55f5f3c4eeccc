"""Whole lines into a file that grows while the vehicle flies: the base of every sink that is one.

Whoever derives from `FileSink` says in `write` which line a fix is.
"""

from __future__ import annotations

import errno
import os
import select
import stat
import sys
from typing import Any, Self

from trexton.base.errors import ParameterError
from trexton.onboard.sinks.base import Sink, Surroundings

__all__ = ["FileSink"]


def _holds_something(path: str) -> bool:
    return os.path.isfile(path) and os.path.getsize(path) > 0


def _ends_in_half_a_line(path: str) -> bool:
    """As a computer leaves a file that loses its power: a line added to it would be lost too."""
    if not _holds_something(path) or not os.access(path, os.R_OK):
        return False
    with open(path, "rb") as stream:
        stream.seek(-1, os.SEEK_END)
        return stream.read(1) != b"\n"


def _try_out(path: str, keep: bool) -> None:
    """Raise `OSError` where the file could not be opened later on; leaves all as it is."""
    there = os.path.exists(path)
    os.close(os.open(path, os.O_WRONLY | os.O_CREAT, 0o644))
    if not there:
        os.unlink(os.path.realpath(path))
    folder = os.path.dirname(path) or "."
    if not keep and _holds_something(path) and not os.access(folder, os.W_OK):
        raise OSError(errno.EACCES, "what it holds cannot be moved aside")


def _move_aside(path: str) -> None:
    number = 1
    while os.path.lexists(f"{path}.{number}"):
        number += 1
    os.rename(path, f"{path}.{number}")


class FileSink(Sink):
    """A file that takes whole lines, each with one system call, so that neither a crash nor a full
    disk leaves half a line behind.

    Parameters
    ----------
    path : str
        ``-`` for standard output.
    header : str
        First line of a new file; empty for none.
    keep : bool
        Add to what the file holds already; otherwise that is moved to the first free of
        ``path.1``, ``path.2`` and so on: a flight's positions are flown only once. That is done
        when it is first opened: a flight that is refused before has touched nothing.
    most_bytes : int, optional
        Size at which the file becomes ``path.1`` (over the one before) and a new one is begun.

    Raises
    ------
    ParameterError
        The file cannot be made at all.
    """

    chosen: Any = None  # of its class of options

    def __init__(
        self, path: str, header: str = "", keep: bool = False, most_bytes: int | None = None
    ):
        self.name = self.file = path
        self._header, self._most_bytes = header, most_bytes
        self._opened: Any = None  # its descriptor, while it is open
        self._fresh = not keep
        if not self._standard:
            try:
                _try_out(path, keep)
            except OSError as error:
                raise ParameterError(
                    f"{path}: cannot be written ({error.strerror}): "
                    "give a file in a folder that exists"
                ) from None

    @classmethod
    def make(cls, address: str, options: Any, around: Surroundings) -> Self:
        """The sink of an address ``KIND:FILE``; raises `ParameterError` where it names no file."""
        if not address:
            raise ParameterError(
                f"output {around.kind!r} names no file: give {around.kind}:FILE, or "
                f"{around.kind}:- for standard output"
            )
        made = cls(address)
        made.name, made.chosen = f"{around.kind}:{address}", options
        return made

    @property
    def _standard(self) -> bool:
        return self.file == "-"

    def open(self) -> None:
        """Open for adding; the header goes in where the file is still empty."""
        if self._standard:
            if sys.stdout is None:
                raise OSError(errno.EBADF, "there is no standard output")
            self._opened = os.dup(sys.stdout.fileno())
        else:
            if self._fresh and _holds_something(self.file):
                _move_aside(self.file)
            self._fresh = False
            self._opened = os.open(self.file, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
        self._regular = stat.S_ISREG(os.fstat(self._opened).st_mode)
        if self._regular and not self._standard and _ends_in_half_a_line(self.file):
            self._add("")
        if self._header and (self._standard or os.fstat(self._opened).st_size == 0):
            self._add(self._header)

    def add(self, line: str) -> None:
        """Add one line.

        Raises
        ------
        OSError
            The disk is full, the file was deleted or moved, or the reader of a pipe is too slow:
            an error, not a wait.
        """
        if self._regular and not self._standard:
            self._check_place(len(line))
        self._add(line)

    def _check_place(self, coming: int) -> None:
        facts = os.fstat(self._opened)
        try:
            there = os.stat(self.file)
        except FileNotFoundError:
            raise OSError(errno.ENOENT, "the file was deleted; a new one is begun") from None
        if (there.st_dev, there.st_ino) != (facts.st_dev, facts.st_ino):
            raise OSError(errno.ENOENT, "another file was put in its place; that one goes on")
        if self._most_bytes is not None and facts.st_size + coming > self._most_bytes:
            os.replace(self.file, self.file + ".1")
            self.close()
            self.open()

    def _add(self, line: str) -> None:
        if not select.select([], [self._opened], [], 0)[1]:
            raise BlockingIOError(errno.EAGAIN, "its reader is too slow")
        data = (line + "\n").encode()
        size = os.fstat(self._opened).st_size
        written = os.write(self._opened, data)
        if written < len(data):
            if self._regular:
                os.ftruncate(self._opened, size)  # half a line never
            raise OSError(errno.ENOSPC, "the disk is full: a line was left out")

    def close(self) -> None:
        """Close; the file can be opened again."""
        if self._opened is not None:
            os.close(self._opened)
            self._opened = None
