"""What a person reads while something runs goes to stderr; `--quiet` silences it. Offers
`progress`, `say`, and `shown`, which escapes a terminal's codes."""

import sys
from collections.abc import Iterable, Iterator
from typing import Any, TextIO, TypeVar

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
        print(shown(message), file=sys.stderr, flush=True)


def shown(text: str, kept: str = "\n\t\xa0\u202f") -> str:
    """A text with what a terminal would obey as a code: ``\\x1b``; lines stay lines."""
    return "".join(
        each if each.isprintable() or each in kept else ascii(each)[1:-1] for each in text
    )


class Shown:
    """A stream for people, to which texts go as `shown`."""

    def __init__(self, stream: TextIO):
        self._stream = stream

    def write(self, text: str) -> int:
        self._stream.write(shown(text))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._stream, name)


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
