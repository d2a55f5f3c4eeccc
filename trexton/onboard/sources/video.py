"""Any video file or URL that OpenCV opens: files are replayed, streams are live."""

from __future__ import annotations

import math
import re
import stat
import time
from collections.abc import Callable
from pathlib import Path

import cv2

from trexton.errors import ImageError
from trexton.images import yuv_from_bgr
from trexton.onboard.sources.base import CameraLost, Frame, Source, SourceOptions
from trexton.onboard.sources.pacing import Paced

__all__ = ["StreamSource", "VideoFile", "make", "matches"]


def matches(address: str) -> bool:
    return _is_stream(address) or Path(address).is_file()


def make(address: str, options: SourceOptions) -> Source:
    if _is_stream(address) or address.startswith("/dev/"):
        return StreamSource(address)
    if not Path(address).is_file():
        raise ImageError(f"{address}: no such video: give a file, a URL or a GStreamer pipeline")
    return (
        Paced(VideoFile(address, options))
        if options.pace == "stamps"
        else VideoFile(address, options)
    )


def _is_stream(address: str) -> bool:
    """A URL, a GStreamer pipeline, a device or a named pipe: what goes on whether it is read or not."""
    if re.match(r"\w+://", address) or " ! " in address:
        return True
    try:
        mode = Path(address).stat().st_mode
    except OSError:
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)


class StreamSource(Source):
    """A live stream (RTSP, HTTP, TCP, a named pipe, GStreamer where OpenCV has it), stamped at the grab."""

    def __init__(
        self,
        address: str,
        capture: Callable = cv2.VideoCapture,
        clock: Callable[[], float] = time.monotonic,
    ):
        self.address, self._make_capture, self._clock = address, capture, clock
        self._capture = None

    def open(self) -> None:
        self._capture = self._make_capture(self.address)
        if not self._capture.isOpened():
            raise CameraLost(
                f"{self.address}: cannot be opened: check that the stream runs and that OpenCV knows its kind"
            )

    def read(self) -> Frame | None:
        if not self._capture.grab():
            raise CameraLost(f"{self.address}: the stream has ended or broken off")
        stamp = self._clock()
        arrived, image = self._capture.retrieve()
        return Frame(stamp, yuv_from_bgr(image) if arrived else None)

    def close(self) -> None:
        if self._capture is not None:
            self._capture.release()
            self._capture = None


class VideoFile(Source):
    """A recorded video, every frame of it; stamps by its frame rate."""

    live = False

    def __init__(self, path: str, options: SourceOptions):
        self.path, self.options = path, options
        self._capture = None
        self._index, self._lap = 0, 0

    def open(self) -> None:
        self._capture = cv2.VideoCapture(self.path)
        if not self._capture.isOpened():
            raise ImageError(
                f"{self.path}: not a video that OpenCV can open: convert it, or give a folder of images"
            )
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        self.period_s = 1 / rate if math.isfinite(rate) and rate > 0 else self.options.period_s

    def read(self) -> Frame | None:
        arrived, image = self._capture.read()
        while not arrived:
            self._lap += 1
            if self._lap >= self.options.laps:
                return None
            self.close()
            self.open()
            arrived, image = self._capture.read()
        self._index += 1
        return Frame((self._index - 1) * self.period_s, yuv_from_bgr(image))

    def close(self) -> None:
        if self._capture is not None:
            self._capture.release()
            self._capture = None
