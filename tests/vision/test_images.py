"""How blurred a picture is."""

import cv2
import numpy as np

from trexton.vision.images import blur_effect


def test_blur_grows_from_sharp_to_blurred(rng):
    sharp = rng.integers(0, 256, (96, 128), dtype=np.uint8)
    effects = [blur_effect(cv2.GaussianBlur(sharp, (0, 0), sigma)) for sigma in (1, 3, 6)]
    assert blur_effect(sharp) < effects[0] < effects[1] < effects[2] < 1
