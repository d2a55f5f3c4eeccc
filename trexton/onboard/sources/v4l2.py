"""A camera of the kernel (V4L2): its UYVY bytes as they are, with no way round through BGR."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import cv2

from trexton.base.errors import ImageError
from trexton.base.options import Options
from trexton.onboard.sources.base import CameraLost, Expected, Frame
from trexton.onboard.sources.video import StreamSource
from trexton.vision.images import yuv_from_uyvy

__all__ = ["V4l2Source"]


class V4l2Source(StreamSource):
    """Packed 4:2:2 frames of a V4L2 device; YUYV is the same pairs of bytes turned round.

    Parameters
    ----------
    device : str
    around : Expected
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
    def make(cls, address: str, options: Options, around: Expected) -> V4l2Source:
        return cls(address, around)

    def __init__(self, device: str, around: Expected, *more: Any):
        super().__init__(device, *more)
        self.around, self._reversed = around, False

    def open(self) -> None:
        capture = self._make_capture(self.address, cv2.CAP_V4L2)
        if not capture.isOpened():
            raise CameraLost(
                f"{self.address}: cannot be opened: "
                "check cable, permissions, and that nobody else uses it"
            )
        capture.set(cv2.CAP_PROP_FOURCC, cv2.VideoWriter.fourcc(*"UYVY"))
        if self.around.shape is not None:
            rows, columns = self.around.shape
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
        raw = frame.picture
        try:
            picture = (
                raw if raw is None else yuv_from_uyvy(raw[..., ::-1] if self._reversed else raw)
            )
        except (ImageError, IndexError):
            picture = None
        return replace(frame, picture=picture)
