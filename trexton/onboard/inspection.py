"""Is this frame worth localizing? The checks that the camera may fail without saying so."""

from __future__ import annotations

import numpy as np

__all__ = ["Inspector"]

STRIDE = 8  # one pixel in 64 tells black from white and one frame from the next
BLACK, WHITE = 12, 243
SHARE = 0.98


class Inspector:
    """Names the fault of a frame, or None.

    Parameters
    ----------
    shape : (rows, columns) or None
        The map's image size; None where the map was trained on histograms.
    """

    def __init__(self, shape: tuple[int, int] | None):
        self.shape = shape
        self._last: np.ndarray | None = None
        self.frozen = 0  # frames in a row that repeat the one before

    def check(self, picture: np.ndarray) -> str | None:
        """The fault of an ``(H, W, 3) uint8`` image; a histogram has none."""
        if picture.ndim == 1:
            return None
        if self.shape is not None and picture.shape[:2] != self.shape:
            return "size"
        sample = picture[::STRIDE, ::STRIDE].copy()
        # Sensor noise alone makes two frames differ: equal bytes mean that the camera
        # repeats itself.
        same = self._last is not None and np.array_equal(sample, self._last)
        self._last, self.frozen = sample, self.frozen + 1 if same else 0
        luma = sample[..., 0]
        if np.mean(luma <= BLACK) >= SHARE:
            return "dark"
        if np.mean(luma >= WHITE) >= SHARE:
            return "bright"
        return "frozen" if same else None
