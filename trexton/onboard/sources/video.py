"""Live cameras as a source. Any URL, pipe or device that OpenCV opens will do (`StreamSource`)."""

import os
import re
import stat
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2

from trexton.base.errors import ImageError, ParameterError
from trexton.base.options import Options
from trexton.onboard.sources import CameraLost, Frame, Shape, Source
from trexton.vision.images import check_capture, decode_image, yuv_from_bgr

JPEG = b"\xff\xd8"
_CAMERA = re.compile(r"/dev/video\d+")


class StreamSource(Source):
    """A camera or live stream (V4L2, RTSP, HTTP, TCP, a named pipe, GStreamer where OpenCV has it),
    read to its end and stamped as it arrives.

    JPEG is decoded here where OpenCV gives it as it is: its own reader fills up a picture that was
    cut short, bends one of another size to the first one's, and says nothing of either.

    Parameters
    ----------
    address : str
    shape : (rows, columns), optional
        The image size that a camera is asked for.
    """

    addresses = {
        "/dev/video0": "a V4L2 camera, asked for the size it was surveyed at",
        "rtsp://…, http://…, tcp://…": "a stream, whatever the installed OpenCV opens, live",
        "camera.y4m": "the same through a named pipe, or a GStreamer pipeline",
    }
    gives = "images"

    @staticmethod
    def matches(address: str) -> bool:
        """A URL, a GStreamer pipeline, a camera or a named pipe: what goes on whether it is read or
        not."""
        if re.match(r"\w+://", address) or " ! " in address or _CAMERA.fullmatch(address):
            return True
        try:
            mode = Path(address).stat().st_mode
        except OSError:
            return False
        return stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)

    @classmethod
    def make(cls, address: str, options: Options, around: Shape) -> Source:
        file = address.removeprefix("file://")
        if os.path.isfile(file) and not file.endswith(".sdp"):  # it would be read in no time
            raise ParameterError(f"{address}: a file is no live camera: trexton import it")
        return cls(address, around)

    def __init__(self, address: str, shape: Shape = None):
        self.address, self.shape = address, shape
        self._capture: Any = None

    def open(self) -> None:
        camera = _CAMERA.fullmatch(self.address)
        self._capture = cv2.VideoCapture(self.address, cv2.CAP_V4L2 if camera else cv2.CAP_ANY)
        if not self._capture.isOpened():
            raise CameraLost(
                f"{self.address}: cannot be opened: check that it runs, that OpenCV knows it, "
                "and that nobody else uses it"
            )
        if camera and self.shape is not None:
            self._capture.set(cv2.CAP_PROP_FRAME_WIDTH, self.shape[1])
            self._capture.set(cv2.CAP_PROP_FRAME_HEIGHT, self.shape[0])
            self._capture.set(cv2.CAP_PROP_BUFFERSIZE, 1)
        check_capture(self._capture, self.address)
        code = int(self._capture.get(cv2.CAP_PROP_FOURCC)) & 0xFFFFFFFF
        jpeg = code.to_bytes(4, "little") in (b"MJPG", b"mjpg", b"JPEG", b"jpeg")
        self._raw = bool(jpeg and self._capture.set(cv2.CAP_PROP_FORMAT, -1))

    def read(self) -> Frame | None:
        if not self._capture.grab():
            raise CameraLost(f"{self.address}: gives no frames any more")
        stamp = time.monotonic()  # at the grab: what follows takes time
        arrived, image = self._capture.retrieve()
        return Frame(stamp, image if arrived else None)

    def decoded(self, frame: Frame) -> Frame:
        """With Y, U, V of what the capture retrieved; None where it cannot be decoded."""
        image = frame.picture
        if image is None:
            return frame
        try:
            raw = self._raw and bytes(image.reshape(-1)[:2]) == JPEG
            return replace(
                frame, picture=decode_image(image.tobytes()) if raw else yuv_from_bgr(image)
            )
        except ImageError:
            return replace(frame, picture=None)

    def close(self) -> None:
        if self._capture is not None:
            self._capture.release()
            self._capture = None
