"""Recordings as others leave them: a TUM folder, a film of JPEGs."""

from collections.abc import Iterable
from pathlib import Path

import cv2
import numpy as np


def recording(folder, frames=24):
    """A TUM folder: a camera that moves over a floor of noise."""
    (folder / "rgb").mkdir(parents=True)
    floor = cv2.resize(np.random.default_rng(4).integers(0, 256, (60, 90, 3), np.uint8), (900, 600))
    images, track = [], []
    for i in range(frames):
        left, top = 20 * i, 150 + round(100 * np.sin(i / 3))
        cv2.imwrite(str(folder / "rgb" / f"{i}.png"), floor[top : top + 120, left : left + 160])
        images.append(f"{0.4 * i:.3f} rgb/{i}.png")
        track.append(f"{0.4 * i:.3f} {left / 100} {top / 100} 1 0 0 0 1")
    (folder / "rgb.txt").write_text("\n".join(images))
    (folder / "groundtruth.txt").write_text("\n".join(track))


def film(path: Path, frames: Iterable[np.ndarray], rate: float = 20.0, codec="MJPG") -> Path:
    """A video file, of JPEGs unless another codec is named; `frames` are BGR, of one size."""
    first, *others = frames
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter_fourcc(*codec), rate, first.shape[1::-1])
    for frame in (first, *others):
        writer.write(frame)
    writer.release()
    return path
