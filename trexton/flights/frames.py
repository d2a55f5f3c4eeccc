"""The images of a flight, handed out one at a time, wherever they come from.

`Frames` is what a flight asks for: `ImageFiles`, `VideoFrames`, or another source that can only be
read `Forward`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

import cv2
import numpy as np

from trexton.base.errors import FlightError
from trexton.base.files import digest
from trexton.vision.images import check_capture, read_image, yuv_from_bgr

__all__ = [
    "Forward", "Frames", "ImageFiles", "Selected", "VideoFrames", "select_frames", "stamped_frames",
]  # fmt: skip


class Frames(Protocol):
    """What a flight needs to know of its images; they are read when asked for."""

    def __len__(self) -> int:
        """How many there are."""

    def __getitem__(self, row: int, /) -> np.ndarray:
        """The image at `row` as ``(H, W, 3) uint8`` Y, U, V."""

    @property
    def digest(self) -> str:
        """Equal for equal images: what was computed from them is found again by it."""


@dataclass(frozen=True)
class ImageFiles:
    """One file an image."""

    files: tuple[Path, ...]

    def __len__(self) -> int:
        return len(self.files)

    def __getitem__(self, row: int) -> np.ndarray:
        return read_image(self.files[row])

    @cached_property
    def digest(self) -> str:
        return digest(*self.files)


@dataclass(frozen=True, eq=False)
class Selected:
    """Some of the frames: ``rows`` of them, in this order."""

    frames: Frames
    rows: np.ndarray

    def __len__(self) -> int:
        return len(self.rows)

    def __getitem__(self, row: int) -> np.ndarray:
        return self.frames[int(self.rows[row])]

    @cached_property
    def digest(self) -> str:
        return digest(self.frames.digest, self.rows)


def select_frames(frames: Frames, rows: np.ndarray) -> Frames:
    """The frames at these rows, in this order; files stay files."""
    if isinstance(frames, ImageFiles):
        return ImageFiles(tuple(frames.files[row] for row in rows))
    return Selected(frames, np.asarray(rows))


class Forward:
    """Frames of a source that can only be read forwards, by one thread; going back starts anew.

    A subclass gives `items`, which are cheap to pass over, and decodes the one that is wanted.
    """

    def __init__(self, source: Path, count: int):
        self.source, self._count = source, count
        self._stream: Iterator[Any] | None = None
        self._next = 0

    @abstractmethod
    def items(self) -> Iterator[Any]:
        """All frames from the first, as the source has them."""

    @abstractmethod
    def decoded(self, item: Any) -> np.ndarray:
        """``(H, W, 3) uint8`` BGR of an item."""

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, row: int) -> np.ndarray:
        if not 0 <= row < self._count:
            raise IndexError(row)
        if self._stream is None or row < self._next:
            self._stream, self._next = self.items(), 0
        for item in self._stream:
            self._next += 1
            if self._next > row:
                if self._next == self._count:
                    self._stream = None  # what was opened is closed with the last
                return yuv_from_bgr(self.decoded(item))
        raise FlightError(
            f"{self.source}: frame {row} can no longer be read: record or copy it again"
        )

    @cached_property
    def digest(self) -> str:
        files = [self.source] if self.source.is_file() else sorted(self.source.rglob("*"))
        return digest(self._count, *(file for file in files if file.is_file()))


class VideoFrames(Forward):
    """All frames of a video file."""

    def items(self) -> Iterator[np.ndarray]:
        return (frame for _, frame in stamped_frames(self.source))

    def decoded(self, item: np.ndarray) -> np.ndarray:
        return item


def stamped_frames(video: Path, announced: list[float] | None = None) -> Iterator[Any]:
    """Stamp in seconds and BGR of each frame; where stamps are missing, by the stated rate.

    How many frames the head of the file names goes into `announced`.
    """
    capture = cv2.VideoCapture(str(video))
    try:
        check_capture(capture, video)
        if announced is not None:
            announced.append(capture.get(cv2.CAP_PROP_FRAME_COUNT))
        rate = capture.get(cv2.CAP_PROP_FPS) or 25.0
        last, number = -1.0, 0
        while True:
            good, frame = capture.read()
            if not good:
                return
            stamp = capture.get(cv2.CAP_PROP_POS_MSEC) / 1000
            stamp = stamp if stamp > last else last + 1 / rate if number else 0.0
            yield stamp, frame
            last, number = stamp, number + 1
    finally:
        capture.release()
