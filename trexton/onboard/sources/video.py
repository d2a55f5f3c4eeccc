"""Live cameras: any URL, pipe or device that OpenCV opens (`StreamSource`), a camera of the kernel
with its UYVY bytes as they are (`V4l2Source`), and what is made of pictures (`Pictures`)."""

from __future__ import annotations

import re
import stat
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from trexton.base.errors import ImageError
from trexton.base.options import Options
from trexton.onboard.sources import CameraLost, Frame, Shape, Source
from trexton.vision.images import check_capture, decode_image, yuv_from_bgr, yuv_from_uyvy

__all__ = ["Pictures", "StreamSource", "V4l2Source", "is_stream"]

Capture = Callable[..., Any]
JPEG = b"\xff\xd8"


def is_stream(address: str) -> bool:
    """A URL, a GStreamer pipeline, a camera or a named pipe: what goes on whether it is read or
    not."""
    if re.match(r"\w+://", address) or " ! " in address:
        return True
    try:
        mode = Path(address).stat().st_mode
    except OSError:
        return False
    return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)


class Pictures:
    """Pictures of a capture, decoded here where it is JPEG.

    OpenCV's video reader fills up a JPEG that was cut short, and bends a picture of another size to
    the first one's, and says nothing of either.
    """

    def __init__(self, capture: Any, address: str):
        check_capture(capture, address)
        self._capture = capture
        code = int(capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
        raw = code.to_bytes(4, "little") in (b"MJPG", b"mjpg", b"JPEG", b"jpeg")
        self._raw = bool(raw and capture.set(cv2.CAP_PROP_FORMAT, -1))

    def picture(self, image: np.ndarray | None) -> np.ndarray | None:
        """Y, U, V of what the capture retrieved; None where it cannot be decoded."""
        if image is None:
            return None
        try:
            if self._raw and bytes(image.reshape(-1)[:2]) == JPEG:
                return decode_image(image.tobytes())
            return yuv_from_bgr(image)
        except ImageError:
            return None


class StreamSource(Source):
    """A live stream (RTSP, HTTP, TCP, a named pipe, GStreamer where OpenCV has it), read to its end
    and stamped as it arrives."""

    addresses = {
        "rtsp://…, http://…, tcp://…": "a stream, whatever the installed OpenCV opens, live",
        "camera.y4m": "the same through a named pipe, or a GStreamer pipeline",
        "stream:/dev/video0": "a camera that gives only compressed frames",
    }
    gives = "images"

    @staticmethod
    def matches(address: str) -> bool:
        return is_stream(address)

    @classmethod
    def make(cls, address: str, options: Options, around: Shape) -> Source:
        return cls(address)

    def __init__(
        self,
        address: str,
        capture: Capture = cv2.VideoCapture,
        clock: Callable[[], float] = time.monotonic,
    ):
        self.address, self._make_capture, self._clock = address, capture, clock
        self._capture: Any = None

    def open(self) -> None:
        self._capture = self._make_capture(self.address)
        if not self._capture.isOpened():
            raise CameraLost(
                f"{self.address}: cannot be opened: "
                "check that the stream runs and that OpenCV knows its kind"
            )
        self._pictures = Pictures(self._capture, self.address)

    def read(self) -> Frame | None:
        if not self._capture.grab():
            raise CameraLost(f"{self.address}: gives no frames any more")
        stamp = self._clock()  # at the grab: what follows takes time
        arrived, image = self._capture.retrieve()
        return Frame(stamp, image if arrived else None)

    def decoded(self, frame: Frame) -> Frame:
        return replace(frame, picture=self._pictures.picture(frame.picture))

    def close(self) -> None:
        if self._capture is not None:
            self._capture.release()
            self._capture = None


class V4l2Source(StreamSource):
    """Packed 4:2:2 frames of a V4L2 device, with no way round through BGR; YUYV is the same pairs
    of bytes turned round.

    Parameters
    ----------
    device : str
    shape : (rows, columns) or None
        The image size to ask for.
    more
        As for `StreamSource`.
    """

    addresses = {
        "/dev/video0": "a V4L2 camera, asked for UYVY at the map's size; its bytes as they are",
    }

    @staticmethod
    def matches(address: str) -> bool:
        return re.fullmatch(r"/dev/video\d+", address) is not None

    @classmethod
    def make(cls, address: str, options: Options, around: Shape) -> V4l2Source:
        return cls(address, around)

    def __init__(self, device: str, shape: Shape, *more: Any):
        super().__init__(device, *more)
        self.shape, self._reversed = shape, False

    def open(self) -> None:
        capture = self._make_capture(self.address, cv2.CAP_V4L2)
        if not capture.isOpened():
            raise CameraLost(
                f"{self.address}: cannot be opened: "
                "check cable, permissions, and that nobody else uses it"
            )
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"UYVY"))
        if self.shape is not None:
            rows, columns = self.shape
            capture.set(cv2.CAP_PROP_FRAME_WIDTH, columns)
            capture.set(cv2.CAP_PROP_FRAME_HEIGHT, rows)
        capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        capture.set(cv2.CAP_PROP_CONVERT_RGB, 0)
        code = int(capture.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, "little").decode("latin-1")
        if code not in ("UYVY", "YUYV"):
            capture.release()
            raise CameraLost(
                f"{self.address}: gives {code!r} frames: UYVY or YUYV expected; "
                f"open it as stream:{self.address}"
            )
        self._capture, self._reversed = capture, code == "YUYV"

    def decoded(self, frame: Frame) -> Frame:
        picture = frame.picture
        try:
            if picture is not None:
                picture = yuv_from_uyvy(picture[..., ::-1] if self._reversed else picture)
        except (ImageError, IndexError):
            picture = None
        return replace(frame, picture=picture)
