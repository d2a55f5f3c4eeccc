"""Recordings: flights, folders of images, video files (`FlightSource`, `ImageFolder`,
`VideoFile`); each says what one lap is, and `Recording` plays it as often as asked for."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2

from trexton.base.errors import FlightError, ImageError
from trexton.base.options import Options
from trexton.flights import Flight, read_flight
from trexton.onboard.sources.base import Expected, Frame, Playback, Source
from trexton.onboard.sources.video import Pictures, StreamSource, is_stream
from trexton.vision.images import natural_order, read_image

__all__ = ["FlightSource", "ImageFolder", "Recording", "VideoFile"]

SUFFIXES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")


class Recording(Source):
    """Every frame of a recording in order; stamps and numbers of further laps go on where the last
    one ended.

    Parameters
    ----------
    laps : int
    """

    live = False
    gives = "images"
    options = Playback

    def __init__(self, laps: int = 1):
        self._played = self._play(laps)

    @abstractmethod
    def lap(self) -> Iterator[Frame]:
        """The frames, once."""

    def read(self) -> Frame | None:
        return next(self._played, None)

    def _play(self, laps: int) -> Iterator[Frame]:
        passed, counted = 0.0, 0
        for _ in range(laps):
            frames, began, stamp, last = 0, 0.0, 0.0, None
            for frame in self.lap():
                began = began if frames else frame.time
                frames, stamp, last = frames + 1, frame.time, frame.number
                aiding = None if frame.aiding is None else frame.aiding.shifted(passed)
                number = None if last is None else last + counted
                yield replace(frame, time=stamp + passed, number=number, aiding=aiding)
            passed += (stamp - began) + (stamp - began) / max(frames - 1, 1)
            counted += 0 if last is None else last + 1


def _parted(address: str) -> tuple[str, str | None]:
    """Folder and part of an address; a folder may have a # in its own name."""
    if "#" not in address or (Path(address) / "flight.toml").is_file():
        return address, None
    folder, _, part = address.rpartition("#")
    return folder, part


class FlightSource(Recording):
    """A recorded flight with its own stamps: its images, or its histograms where it has none."""

    rectified = True  # as they were imported

    addresses = {
        "my-flight": "a recorded flight, a folder with `flight.toml`",
        "my-flight#test": "one of its parts",
    }

    @staticmethod
    def matches(address: str) -> bool:
        return (Path(_parted(address)[0]) / "flight.toml").is_file()

    @classmethod
    def make(cls, address: str, options: Playback, around: Expected) -> Source:
        folder, part = _parted(address)
        flight = read_flight(folder)
        if part is not None:
            flight = flight.part(part)
        if not len(flight):
            raise FlightError(f"{address}: no frames: nothing to replay")
        return cls(flight, options.laps, folder)

    def __init__(self, flight: Flight, laps: int = 1, folder: str | None = None):
        super().__init__(laps)
        self.flight = flight
        self.gives = "images" if flight.has_images else "histograms"
        self.files = () if folder is None else (folder,)

    def lap(self) -> Iterator[Frame]:
        flight = self.flight
        for row, (stamp, number) in enumerate(zip(flight.time, flight.frame, strict=True)):
            frame = Frame(float(stamp), None, int(number))
            if flight.histograms is not None and not flight.has_images:
                yield replace(frame, picture=flight.histograms[row])
                continue
            assert flight.frames is not None
            try:  # one of another size is refused by the loop, as from a camera
                yield replace(frame, picture=flight.frames[row], aiding=flight.aiding(row))
            except ImageError:
                yield frame


class ImageFolder(Recording):
    """The images of a folder, `period_s` apart; an unreadable one is a frame that cannot be
    decoded."""

    addresses = {
        "images/": "a folder of images, in the order of the numbers in their names",
    }

    @staticmethod
    def matches(address: str) -> bool:
        return Path(address).is_dir()

    @classmethod
    def make(cls, address: str, options: Playback, around: Expected) -> Source:
        return cls(address, options, around)

    def __init__(self, folder: str, options: Playback, around: Expected):
        super().__init__(options.laps)
        self.pictures = sorted(
            (file for file in Path(folder).iterdir() if file.suffix.lower() in SUFFIXES),
            key=natural_order,
        )
        if not self.pictures:
            raise ImageError(
                f"{folder}: no images ({', '.join(SUFFIXES)}): give a folder that holds some"
            )
        self.files, self.period_s = (folder,), around.period_s

    def lap(self) -> Iterator[Frame]:
        for row, file in enumerate(self.pictures):
            try:
                yield Frame(row * self.period_s, read_image(file))
            except ImageError:
                yield Frame(row * self.period_s, None)


class VideoFile(Recording):
    """A recorded video; stamps by its frame rate."""

    addresses = {"floor.avi": "a video file, every frame of it"}

    @staticmethod
    def matches(address: str) -> bool:
        return Path(address).is_file()

    @classmethod
    def make(cls, address: str, options: Playback, around: Expected) -> Source:
        if is_stream(address) or address.startswith("/dev/"):
            return StreamSource.make(address, Options(), around)
        if not Path(address).is_file():
            raise ImageError(
                f"{address}: no such video: give a file, a URL or a GStreamer pipeline"
            )
        return cls(address, options, around)

    def __init__(self, path: str, options: Playback, around: Expected):
        super().__init__(options.laps)
        self.path, self.around, self.files = path, around, (path,)
        self._capture: Any = None

    def open(self) -> None:
        self._capture = cv2.VideoCapture(self.path)
        if not self._capture.isOpened():
            raise ImageError(
                f"{self.path}: not a video that OpenCV can open: "
                "convert it, or give a folder of images"
            )

    def lap(self) -> Iterator[Frame]:
        if self._capture is None:
            self.open()
        pictures = Pictures(self._capture, self.path)
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        period_s = 1 / rate if math.isfinite(rate) and rate > 0 else self.around.period_s
        row = 0
        while (read := self._capture.read())[0]:
            yield Frame(row * period_s, pictures.picture(read[1]))
            row += 1
        self.close()

    def close(self) -> None:
        if self._capture is not None:
            self._capture.release()
            self._capture = None
