"""The images of an import. They are undistorted, cropped, scaled, and written."""

import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from trexton.base.errors import ImageError, ParameterError
from trexton.base.progress import progress
from trexton.flights.frames import Forward, ImageFiles
from trexton.flights.importers.recording import Recording, unreadable
from trexton.vision.calibration import read_calibration
from trexton.vision.camera import Rectification
from trexton.vision.images import bgr_from_yuv, size_of

QUALITY = 95  # of JPEG files that are written anew
FEWEST_WHOLE, _UNREADABLE = 3, (0, 0)  # images from which on others may be left out; their size


def of_one_size(recording: Recording) -> Recording:
    """The frames whose image is whole and of the size of most, of two the larger; said of others.
    Raises `ImageError` where most images cannot be read.
    """
    if not isinstance(frames := recording.frames, ImageFiles):
        return recording
    sizes, damaged = [], []
    for file in progress(frames.files, "sizes"):
        try:
            sizes.append(size_of(file))
        except ImageError as error:
            sizes.append(_UNREADABLE)
            damaged.append(error)
    width, height = usual = max(set(sizes), key=lambda size: (sizes.count(size), size))
    if damaged and (usual == _UNREADABLE or sizes.count(usual) < FEWEST_WHOLE):
        raise damaged[0]
    said = unreadable(damaged)
    if others := [row for row, size in enumerate(sizes) if size not in (usual, _UNREADABLE)]:
        left = f"{len(others)} (first: {frames.files[others[0]].name})"
        said.append(f"images of another size than {width}x{height}, left out: {left}")
    kept = np.array([row for row, size in enumerate(sizes) if size == usual])
    return recording.rows(kept, *said) if said else recording


def rectification_of(
    frames: ImageFiles | Forward, undistort: str, crop: str, scale: float
) -> Rectification:
    """What is done to each image of a recording of one size; see `Common` of importing."""
    height, width = frames[0].shape[:2]
    full = width, height
    lens = _lens(Path(undistort), frames, full) if undistort else ()
    part = _crop(crop, full) if crop else (0, 0, *full)
    size = (round(part[2] * scale), round(part[3] * scale))
    if min(size) < 1:
        raise ParameterError(f"scale {scale:g} leaves nothing of {part[2]}x{part[3]}: give more")
    return Rectification(full, part, size, *lens)


def write_images(frames: ImageFiles | Forward, done: Rectification, folder: Path) -> ImageFiles:
    """Write every image; files that need no change are copied."""
    files = []
    for row in progress(range(len(frames)), "images", len(frames)):
        own = frames.files[row] if isinstance(frames, ImageFiles) else Path()
        kept = not done.changes and own.suffix.lower() in (".jpg", ".jpeg", ".png")
        file = folder / f"{row:06d}{own.suffix.lower() if kept else '.jpg'}"
        if kept:
            file.write_bytes(own.read_bytes())
        else:  # black stays black where a lens is undistorted
            image = done.apply(bgr_from_yuv(frames[row]), border=(0, 0, 0))
            quality = [cv2.IMWRITE_JPEG_QUALITY, QUALITY]
            file.write_bytes(cv2.imencode(".jpg", image, quality)[1].tobytes())
        files.append(file)
    return ImageFiles(tuple(files))


def _crop(text: str, size: tuple[int, int]) -> tuple[int, int, int, int]:
    """x, y, width and height, as in ``160,0,960,720``."""
    try:
        x, y, width, height = (int(each) for each in text.split(","))
    except ValueError:
        raise ParameterError(f"crop {text!r}: expected x,y,width,height in pixels") from None
    if min(x, y) < 0 or min(width, height) < 1 or x + width > size[0] or y + height > size[1]:
        raise ParameterError(f"crop {text}: the images are {size[0]}x{size[1]} pixels")
    return x, y, width, height


def _lens(path: Path, frames: ImageFiles | Forward, size: tuple[int, int]) -> tuple[Any, ...]:
    """Focal length, centre and distortion in a file of OpenCV, EuRoC or Kalibr."""
    # Of several cameras, that whose folder the images lie in.
    files = frames.files[:1] if isinstance(frames, ImageFiles) else ()
    parts = [part for file in files for part in file.parts if re.fullmatch(r"cam\d", part)]
    camera, distortion = read_calibration(path, parts[-1] if parts else "cam0")
    if distortion is None:
        raise ParameterError(f"{path}: no calibration with radial and tangential distortion")
    if (camera.width, camera.height) != size:
        whose = f"the calibration is for {camera.width}x{camera.height}"
        raise ParameterError(f"{whose}, the images are {size[0]}x{size[1]}")
    return camera.focal, camera.principal_point, tuple(distortion.tolist())
