"""A folder of images, in the order of the numbers in their names."""

from __future__ import annotations

import re
from pathlib import Path

from trexton.errors import ImageError
from trexton.images import read_image
from trexton.onboard.sources.base import Frame, Source, SourceOptions
from trexton.onboard.sources.pacing import Paced

__all__ = ["ImageFolder", "make", "matches"]

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")


def matches(address: str) -> bool:
    return Path(address).is_dir()


def make(address: str, options: SourceOptions) -> Source:
    source = ImageFolder(address, options)
    return Paced(source) if options.pace == "stamps" else source


def _natural(path: Path) -> list:
    """Sort key under which frame 2 comes before frame 10."""
    return [
        (0, int(part), "") if part.isdigit() else (1, 0, part)
        for part in re.split(r"(\d+)", path.name)
        if part
    ]


class ImageFolder(Source):
    """The images of a folder, `period_s` apart; an unreadable one is a frame that cannot be decoded."""

    live = False

    def __init__(self, folder: str, options: SourceOptions):
        self.options = options
        self.files = sorted(
            (file for file in Path(folder).iterdir() if file.suffix.lower() in SUFFIXES),
            key=_natural,
        )
        if not self.files:
            raise ImageError(
                f"{folder}: no images ({', '.join(SUFFIXES)}): give a folder that holds some"
            )
        self._next = 0

    def open(self) -> None:
        """Nothing to open: images are read one by one."""

    def read(self) -> Frame | None:
        lap, row = divmod(self._next, len(self.files))
        if lap >= self.options.laps:
            return None
        stamp = self._next * self.options.period_s
        self._next += 1
        try:
            return Frame(stamp, read_image(self.files[row]))
        except ImageError:
            return Frame(stamp, None)
