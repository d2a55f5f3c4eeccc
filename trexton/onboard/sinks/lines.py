"""Whole lines into a file that grows while the vehicle flies."""

from __future__ import annotations

import errno
import os
import select
import sys

from trexton.errors import ParameterError

__all__ = ["LineFile"]


class LineFile:
    """A file that takes whole lines, each with one system call, so that a crash or a full disk leaves no half
    line behind.

    Parameters
    ----------
    path : str
        Empty or ``-`` for standard output.
    header : str
        First line of a new file; empty for none.
    keep : bool
        Add to what the file holds already; otherwise it is emptied.

    Raises
    ------
    ParameterError
        The file cannot be made at all.
    """

    def __init__(self, path: str, header: str = "", keep: bool = False):
        self.path, self._header = path, header
        self._descriptor: int | None = None
        self._torn = False
        if not self._standard:
            try:
                os.close(
                    os.open(path, os.O_WRONLY | os.O_CREAT | (0 if keep else os.O_TRUNC), 0o644)
                )
            except OSError as error:
                raise ParameterError(
                    f"{path}: cannot be written ({error.strerror}): give a file in a folder that exists"
                ) from None

    @property
    def _standard(self) -> bool:
        return self.path in ("", "-")

    def open(self) -> None:
        """Open for adding; the header goes in where the file is still empty."""
        if self._standard:
            sys.stdout.flush()
            self._descriptor = os.dup(sys.stdout.fileno())
        else:
            self._descriptor = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT, 0o644)
        if self._header and (self._standard or os.fstat(self._descriptor).st_size == 0):
            self.write(self._header)

    def write(self, line: str) -> None:
        """Add one line; a pipe whose reader is too slow is an error, not a wait."""
        if not select.select([], [self._descriptor], [], 0)[1]:
            raise BlockingIOError(errno.EAGAIN, "its reader is too slow")
        data = (line + "\n").encode()
        if self._torn:  # the disk filled up in the middle of a line: end it before the next
            data = b"\n" + data
        written = os.write(self._descriptor, data)
        self._torn = written < len(data)
        if self._torn:
            raise OSError(errno.ENOSPC, "only part of a line could be written")

    def close(self) -> None:
        """Close; the file can be opened again."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None
