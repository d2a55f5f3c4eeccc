"""The images of a flight are a file each. Those of a source are read `Forward`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.files import digest
from trexton.vision.images import read_image, yuv_from_bgr


@dataclass(frozen=True)
class ImageFiles:
    """One file an image; read as ``(H, W, 3) uint8`` Y, U, V when asked for."""

    files: tuple[Path, ...]

    def __len__(self) -> int:
        return len(self.files)

    def __getitem__(self, row: int) -> np.ndarray:
        return read_image(self.files[row])

    def at(self, rows: np.ndarray) -> ImageFiles:
        """The images at these rows, in this order."""
        return type(self)(tuple(self.files[row] for row in rows))

    @cached_property
    def digest(self) -> str:
        """Equal for equal images: what was computed from them is found again by it."""
        return digest(*self.files)


@dataclass(eq=False)
class Forward:
    """Images of a source that can only be read forwards, by one thread; going back starts anew.

    Attributes
    ----------
    source : Path
    chosen : (N,) int array
        The wanted ones among all that the source has.
    items : callable
        All of them from the first, cheap to pass over.
    decoded : callable
        ``(H, W, 3) uint8`` BGR of an item.
    """

    source: Path
    chosen: np.ndarray
    items: Callable[[], Iterator[Any]]
    decoded: Callable[[Any], np.ndarray]
    _stream: Iterator[Any] | None = field(default=None, init=False)
    _next: int = field(default=0, init=False)

    def __len__(self) -> int:
        return len(self.chosen)

    def __getitem__(self, row: int) -> np.ndarray:
        wanted = int(self.chosen[row])
        if self._stream is None or wanted < self._next:
            self._stream, self._next = self.items(), 0
        for item in self._stream:
            self._next += 1
            if self._next > wanted:
                return yuv_from_bgr(self.decoded(item))
        raise FlightError(
            f"{self.source}: frame {wanted} can no longer be read: record or copy it again"
        )

    def at(self, rows: np.ndarray) -> Forward:
        """The images at these rows, in this order."""
        return replace(self, chosen=self.chosen[rows])
