"""Camera calibrations: an ASL ``sensor.yaml``, or a file that OpenCV's calibration writes."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from trexton.camera import Camera
from trexton.errors import FlightError
from trexton.flights.tables import read_text

__all__ = ["read_calibration"]


def read_calibration(path: Path) -> tuple[Camera, np.ndarray | None]:
    """The camera and its distortion coefficients (None where all are zero).

    Raises
    ------
    FlightError
        The file is of neither kind.
    """
    text = read_text(path)
    camera, distortion = _opencv(text) or _asl(path, text)
    return camera, distortion if distortion.any() else None


def _opencv(text: str) -> tuple[Camera, np.ndarray] | None:
    try:
        storage = cv2.FileStorage(text, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
        matrix = storage.getNode("camera_matrix").mat()
        distortion = storage.getNode("distortion_coefficients").mat()
        width, height = (
            int(storage.getNode(name).real()) for name in ("image_width", "image_height")
        )
    except (cv2.error, SystemError, OverflowError, ValueError):  # of text that is not its own
        return None
    if matrix is None or distortion is None or matrix.shape != (3, 3) or min(width, height) < 1:
        return None
    focal, center = float(matrix[0, 0] + matrix[1, 1]) / 2, (matrix[0, 2], matrix[1, 2])
    camera = Camera(width, height, focal, center)
    return camera, distortion.ravel()


def _asl(path: Path, text: str) -> tuple[Camera, np.ndarray]:
    import yaml

    try:
        lines = (line for line in text.splitlines() if not line.startswith("%"))
        content = yaml.safe_load("\n".join(lines))
        width, height = (int(value) for value in content["resolution"])
        fx, fy, cx, cy = (float(value) for value in content["intrinsics"])
        distortion = np.array(content.get("distortion_coefficients", []), dtype=float)
    except (
        yaml.YAMLError, ArithmeticError, AttributeError, LookupError, RecursionError, TypeError,
        ValueError,
    ) as error:  # fmt: skip
        why = " ".join(str(error).split())[:200]
        raise FlightError(
            f"{path}: neither a calibration of OpenCV nor of ASL ({why}): correct it"
        ) from None
    return Camera(width, height, (fx + fy) / 2, (cx, cy)), distortion
