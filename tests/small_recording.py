"""A recording as others leave it: a TUM folder."""

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
