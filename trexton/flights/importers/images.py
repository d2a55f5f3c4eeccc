"""The images of an import: undistorted, cropped and scaled to one size, and written."""

from __future__ import annotations

import re
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from trexton.base.errors import FlightError, ParameterError
from trexton.base.progress import progress
from trexton.flights.frames import Frames, ImageFiles
from trexton.flights.importers.recording import Recording
from trexton.vision.camera import Rectification
from trexton.vision.images import bgr_from_yuv, checked_bytes, decode, read_image

__all__ = ["Change", "write_images"]

QUALITY = 95  # of JPEG files that are written anew
_ASPECT = 0.02  # relative difference of aspect up to which an image is scaled to the others' size


@dataclass(frozen=True, eq=False)
class Change:
    """What is done to each image."""

    rectification: Rectification

    @classmethod
    def of(
        cls, recording: Recording, source: Path, undistort: str, mask: str, scale: float
    ) -> Change:
        """By a calibration and a mask where they are named; see `Common` of importing."""
        assert recording.frames is not None
        full = _usual_size(recording.frames)
        lens = _calibration(undistort, recording, source, full) if undistort else {}
        crop = _free_rectangle(mask, full) if mask else (0, 0, *full)
        size = (round(crop[2] * scale), round(crop[3] * scale))
        if min(size) < 1:
            raise ParameterError(
                f"scale {scale:g} leaves nothing of {crop[2]}x{crop[3]} pixels: give more"
            )
        return cls(Rectification(full, crop, size, **lens))

    @property
    def keeps(self) -> bool:
        """Whether images may stay as they are."""
        return not self.rectification.changes

    def suffix(self, frames: Frames, row: int) -> str:
        """Of the file that is written: the source's own where it can be kept."""
        own = frames.files[row].suffix.lower() if isinstance(frames, ImageFiles) else ""
        return own if self.keeps and own in (".jpg", ".jpeg", ".png") else ".jpg"

    def apply(self, frames: Frames, row: int) -> tuple[bytes, bool, bool]:
        """The bytes of the image file, and whether it was turned and scaled to the size of most."""
        image, full = frames[row], self.rectification.source
        size = (image.shape[1], image.shape[0])
        if self.keeps and size == full and isinstance(frames, ImageFiles):
            if self.suffix(frames, row) == frames.files[row].suffix.lower():
                return frames.files[row].read_bytes(), False, False
        image = bgr_from_yuv(image)  # black stays black where a lens is undistorted
        turned = size != full and size[::-1] == full
        if turned:
            image = cv2.rotate(image, cv2.ROTATE_90_CLOCKWISE)
        scaled = image.shape[1::-1] != full
        if scaled:
            aspect = image.shape[1] / image.shape[0] * full[1] / full[0]
            if abs(aspect - 1) > _ASPECT:
                raise FlightError(
                    f"image {row} is {size[0]}x{size[1]} where most are "
                    f"{full[0]}x{full[1]}, "
                    "of another shape: leave it out"
                )
            image = cv2.resize(image, full, interpolation=cv2.INTER_AREA)
        image = self.rectification.apply(image, border=(0, 0, 0))
        quality = [cv2.IMWRITE_JPEG_QUALITY, QUALITY]
        _, data = cv2.imencode(self.suffix(frames, row), image, quality)
        return data.tobytes(), turned, scaled


def write_images(frames: Frames, change: Change, folder: Path) -> tuple[ImageFiles, list[str]]:
    """Write every image, all of one size, and say what was done to them."""
    count = len(frames)
    files, turned, scaled = [], 0, 0
    for row in progress(range(count), "images", count):
        file = folder / f"{row:06d}{change.suffix(frames, row)}"
        files.append(file)
        data, was_turned, was_scaled = change.apply(frames, row)
        turned, scaled = turned + was_turned, scaled + was_scaled
        file.write_bytes(data)
    width, height = change.rectification.size
    said = [f"{count} images of {width}x{height}"]
    if turned or scaled:
        said.append(f"{turned} images were turned upright, {scaled} scaled to the size of most")
    return ImageFiles(tuple(files)), said


def _usual_size(frames: Frames) -> tuple[int, int]:
    """The commonest width and height of files, else those of the first frame."""
    if isinstance(frames, ImageFiles):
        return Counter(read_image(file).shape[1::-1] for file in frames.files).most_common(1)[0][0]
    height, width = frames[0].shape[:2]
    return width, height


def _calibration(
    name: str, recording: Recording, source: Path, size: tuple[int, int]
) -> dict[str, Any]:
    """Focal length, centre and distortion: of the source itself (`own`), an EuRoC ``sensor.yaml``,
    or OpenCV's file.
    """
    camera, distortion = recording.camera, recording.distortion
    if name != "own":
        from trexton.vision.calibration import read_calibration

        # Of several cameras, that whose folder the images lie in.
        files = recording.frames.files[:1] if isinstance(recording.frames, ImageFiles) else ()
        parts = [part for file in files for part in file.parts if re.fullmatch(r"cam\d", part)]
        camera, distortion = read_calibration(Path(name), parts[-1] if parts else "cam0")
    if camera is None or distortion is None:
        where = source if name == "own" else name
        raise ParameterError(
            f"undistort {name!r}: no calibration with radial and tangential distortion in {where}"
        )
    if (camera.width, camera.height) != size:
        raise ParameterError(
            f"the calibration is for {camera.width}x{camera.height}, the images are "
            f"{size[0]}x{size[1]}"
        )
    center = tuple(map(float, camera.principal_point))
    return {
        "focal": float(camera.focal), "center": center, "distortion": tuple(distortion.tolist()),
    }  # fmt: skip


def _free_rectangle(name: str, size: tuple[int, int]) -> tuple[int, int, int, int]:
    """x, y, width and height of the largest upright rectangle without a black pixel of the mask."""
    mask = decode(checked_bytes(Path(name)), cv2.IMREAD_GRAYSCALE)
    if mask is None or mask.shape[1::-1] != size:
        raise ParameterError(f"mask {name}: expected a picture of {size[0]}x{size[1]} pixels")
    heights, best = np.zeros(size[0], int), (0, 0, 0, 0)
    for row, free in enumerate(mask > 0):
        heights = np.where(free, heights + 1, 0)
        stack: list[int] = []
        for place in range(size[0] + 1):
            height = heights[place] if place < size[0] else 0
            while stack and heights[stack[-1]] >= height:
                tall = int(heights[stack.pop()])
                left = stack[-1] + 1 if stack else 0
                if tall * (place - left) > best[2] * best[3]:
                    best = (left, row - tall + 1, place - left, tall)
            stack.append(place)
    if best[2] * best[3] < 0.1 * size[0] * size[1]:
        raise ParameterError(f"mask {name}: no free rectangle of a tenth of the image is left")
    return best
