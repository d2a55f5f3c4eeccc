"""Progress on stderr; `--quiet` silences it for the whole process."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Iterator
from typing import TypeVar

__all__ = ["is_quiet", "progress", "say", "set_quiet"]

T = TypeVar("T")
_quiet = False


def set_quiet(quiet: bool) -> None:
    """Silence (or restore) progress bars and messages."""
    global _quiet
    _quiet = quiet


def is_quiet() -> bool:
    """Whether progress bars and messages are silenced."""
    return _quiet


def say(message: str) -> None:
    """Print one line to stderr unless quiet."""
    if not _quiet:
        print(message, file=sys.stderr, flush=True)


def progress(items: Iterable[T], label: str, total: int | None = None) -> Iterator[T]:
    """Iterate over `items` behind a bar; without tqdm, as on board, or when quiet, just iterate."""
    if not _quiet and sys.stderr.isatty():
        try:
            from tqdm import tqdm
        except ImportError:
            pass
        else:
            return iter(tqdm(items, desc=label, total=total, file=sys.stderr, leave=False))
    return iter(items)
