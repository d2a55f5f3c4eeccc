"""Recordings: flights and video files (`FlightSource`, `VideoFile`). Each says what one lap is,
and `Recording` plays it as often as asked for."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import cv2

from trexton.base.errors import FlightError, ImageError
from trexton.flights import Flight, read_flight
from trexton.onboard.sources import Frame, Playback, Shape, Source
from trexton.onboard.sources.video import Pictures

__all__ = ["FlightSource", "Recording", "VideoFile"]

UNKNOWN_PERIOD = 0.08  # seconds from frame to frame of a video that does not say


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
                number = None if last is None else last + counted
                yield replace(frame.shifted(passed), number=number)
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
    def make(cls, address: str, options: Playback, around: Shape) -> Source:
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


class VideoFile(Recording):
    """A recorded video, or numbered images as OpenCV takes them for one; stamps by its frame
    rate."""

    addresses = {
        "floor.avi": "a video file, every frame of it",
        "images/%04d.png": "numbered images, the first one 0 to 4",
    }

    @staticmethod
    def matches(address: str) -> bool:
        return "%" in address or Path(address).is_file()

    @classmethod
    def make(cls, address: str, options: Playback, around: Shape) -> Source:
        return cls(address, options.laps)

    def __init__(self, path: str, laps: int = 1):
        super().__init__(laps)
        self.path, self.files = path, (path,)

    def lap(self) -> Iterator[Frame]:
        capture = cv2.VideoCapture(self.path)
        if not capture.isOpened():
            raise ImageError(
                f"{self.path}: not a video that OpenCV can open: convert it, or give another"
            )
        pictures = Pictures(capture, self.path)
        rate = capture.get(cv2.CAP_PROP_FPS)
        period_s = 1 / rate if math.isfinite(rate) and rate > 0 else UNKNOWN_PERIOD
        row = 0
        while (read := capture.read())[0]:
            yield Frame(row * period_s, pictures.picture(read[1]))
            row += 1
        capture.release()
