"""A folder of images, in the order of the numbers in their names."""

from __future__ import annotations

from pathlib import Path

from trexton.base.errors import ImageError
from trexton.base.files import natural_order
from trexton.onboard.sources.base import Expected, Frame, Playback, Source
from trexton.vision.images import read_image

__all__ = ["ImageFolder"]

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")


class ImageFolder(Source):
    """The images of a folder, `period_s` apart; an unreadable one is a frame that cannot be
    decoded."""

    live = False

    addresses = {
        "images/": "a folder of images, in the order of the numbers in their names",
    }
    options = Playback

    @staticmethod
    def matches(address: str) -> bool:
        return Path(address).is_dir()

    @classmethod
    def make(cls, address: str, options: Playback, around: Expected) -> Source:
        return cls(address, options, around)

    def __init__(self, folder: str, options: Playback, around: Expected):
        self.playback, self.around = options, around
        self.pictures = sorted(
            (file for file in Path(folder).iterdir() if file.suffix.lower() in SUFFIXES),
            key=natural_order,
        )
        if not self.pictures:
            raise ImageError(
                f"{folder}: no images ({', '.join(SUFFIXES)}): give a folder that holds some"
            )
        self.gives, self.files = "images", (folder,)
        self._next = 0

    def read(self) -> Frame | None:
        lap, row = divmod(self._next, len(self.pictures))
        if lap >= self.playback.laps:
            return None
        stamp = self._next * self.around.period_s
        self._next += 1
        try:
            return Frame(stamp, read_image(self.pictures[row]))
        except ImageError:
            return Frame(stamp, None)
