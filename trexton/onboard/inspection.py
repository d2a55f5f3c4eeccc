"""Is this frame worth localizing? The checks that the camera may fail without saying so."""

from __future__ import annotations

import numpy as np

__all__ = ["Inspector"]

STRIDE = 8  # one pixel in 64 tells black from white and one frame from the next
BLACK, WHITE = 12, 243
SHARE = 0.98
TORN = 0.1  # of the rows, at the top or at the bottom, left over from the frame before


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
        self._repeated = np.zeros(0, bool)  # rows of the last frame that repeated the one before
        self._torn = False  # the last frame
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
        repeated = self._rows_repeated(sample)
        same, torn = bool(repeated.all()), not self._torn and self._is_torn(sample, repeated)
        self._last, self._repeated, self._torn = sample, repeated, torn
        self.frozen = self.frozen + 1 if same else 0
        luma = sample[..., 0]
        if np.mean(luma <= BLACK) >= SHARE:
            return "dark"
        if np.mean(luma >= WHITE) >= SHARE:
            return "bright"
        if same:
            return "frozen"
        return "torn" if torn else None

    def _rows_repeated(self, sample: np.ndarray) -> np.ndarray:
        """``(rows,)`` whether each is the same as in the frame before."""
        if self._last is None or self._last.shape != sample.shape:
            return np.zeros(len(sample), bool)
        repeated: np.ndarray = (sample == self._last).all(axis=(1, 2))
        return repeated

    def _is_torn(self, sample: np.ndarray, repeated: np.ndarray) -> bool:
        """Whether the frame was handed out while the next was written into it: to one side of a
        row all is as before, to the other nothing.

        A bar without noise, black or with letters, was the same before, too. What follows a torn
        frame may repeat its new rows and be whole.
        """
        if np.count_nonzero(repeated[1:] != repeated[:-1]) != 1:
            return False
        flat = np.ptp(sample[..., 0], axis=1) == 0
        bar = self._repeated if self._repeated.shape == repeated.shape else np.zeros_like(repeated)
        left_over = repeated & ~bar & ~flat
        return bool(left_over.mean() >= TORN)
