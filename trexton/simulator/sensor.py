"""The image sensor: light to bytes, in integers, so that equal scenes give equal frames everywhere."""

from __future__ import annotations

import cv2
import numba
import numpy as np

from trexton.camera import Camera
from trexton.simulator.effects import Effects

__all__ = ["Sensor"]

_ONE = 12  # fractional bits of gains
_NOISE = 8  # fractional bits of the noise and of its strength; every product stays within 32 bits
_SPARE = 256  # the noise tile is this much larger than the frame, so that it can be shifted


@numba.njit(cache=True, nogil=True)
def _develop(scene, gain, vignette, noise, row, column, sigma, share_chroma, frame):  # pragma: no cover - compiled
    """Gain, vignette, noise and shared chroma, in that order, for ``(H, W, 3) uint8`` Y, Cr, Cb."""
    int32 = np.int32
    height, width, _ = scene.shape
    gain, half_gain, half_noise = int32(gain), int32(1 << (_ONE - 1)), int32(1 << (2 * _NOISE - 1))
    darkest, grey, brightest = int32(0), int32(128), int32(255)
    for v in range(height):
        for u in range(width):
            factor = (gain * vignette[v, u] + half_gain) >> int32(_ONE)
            drawn = noise[v + row, u + column]
            luma = min(brightest, (int32(scene[v, u, 0]) * factor + half_gain) >> int32(_ONE))
            strength = sigma[luma]
            luma += (drawn[0] * strength + half_noise) >> int32(2 * _NOISE)
            frame[v, u, 0] = min(brightest, max(darkest, luma))
            for channel in range(1, 3):
                color = ((int32(scene[v, u, channel]) - grey) * factor + half_gain) >> int32(_ONE)
                color += (drawn[channel] * strength + half_noise) >> int32(2 * _NOISE + 1)
                frame[v, u, channel] = min(brightest, max(darkest, grey + color))
        if share_chroma:
            for u in range(0, width - 1, 2):
                for channel in range(1, 3):
                    shared = (int32(frame[v, u, channel]) + int32(frame[v, u + 1, channel]) + int32(1)) >> int32(1)
                    frame[v, u, channel] = frame[v, u + 1, channel] = shared


class Sensor:
    """Turns scenes into frames.

    Parameters
    ----------
    camera : Camera
    effects : Effects
        Vignetting, noise, chroma subsampling and JPEG are the sensor's.
    rng : numpy.random.Generator
        Draws the noise once; each frame sees another part of it.
    """

    def __init__(self, camera: Camera, effects: Effects, rng: np.random.Generator):
        self._effects = effects
        shape = (camera.height, camera.width)
        center_x, center_y = camera.principal_point
        squared = (np.arange(camera.width) - center_x) ** 2 + (np.arange(camera.height)[:, None] - center_y) ** 2
        loss = effects.vignetting * squared / squared.max()
        self._vignette = np.rint((1 - loss) * 2**_ONE).astype(np.int32)
        tile = rng.standard_normal((shape[0] + _SPARE, shape[1] + _SPARE, 3), dtype=np.float32)
        self._noise = np.rint(np.clip(tile, -8, 8) * 2**_NOISE).astype(np.int32)
        # Photons arrive one by one: the noise's variance grows with the light, on top of what reading out adds.
        levels = np.arange(256)
        self._sigma = np.rint(effects.noise * np.sqrt(0.3 + 0.7 * levels / 128) * 2**_NOISE).astype(np.int32)

    @staticmethod
    def draw_offset(rng: np.random.Generator) -> tuple[int, int]:
        """Which part of the noise the next frame sees; even columns, as two pixels may share chroma."""
        return int(rng.integers(_SPARE)), 2 * int(rng.integers(_SPARE // 2))

    def develop(self, scene: np.ndarray, gain: float, offset: tuple[int, int]) -> np.ndarray:
        """``(H, W, 3) uint8`` Y, Cr, Cb as the sensor delivers it."""
        share = self._effects.chroma_subsampling > 0
        frame = np.empty_like(scene)
        _develop(scene, round(gain * 2**_ONE), self._vignette, self._noise, *offset, self._sigma, share, frame)
        return frame

    @property
    def suffix(self) -> str:
        """Of the files that `encode` makes."""
        return ".jpg" if self._effects.jpeg else ".png"

    def encode(self, frame: np.ndarray) -> bytes:
        """A developed frame as the bytes of a JPEG file, or of a PNG file where JPEG is off."""
        image = cv2.cvtColor(frame, cv2.COLOR_YCrCb2BGR)
        if not self._effects.jpeg:
            return cv2.imencode(".png", image, [cv2.IMWRITE_PNG_COMPRESSION, 1])[1].tobytes()
        shared = self._effects.chroma_subsampling > 0
        factor = cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422 if shared else cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444
        options = [cv2.IMWRITE_JPEG_QUALITY, round(self._effects.jpeg), cv2.IMWRITE_JPEG_SAMPLING_FACTOR, factor]
        return cv2.imencode(".jpg", image, options)[1].tobytes()

    def deliver(self, frame: np.ndarray) -> np.ndarray:
        """A developed frame as Y, U, V, exactly as it would be read back from the file of `encode`."""
        if self._effects.jpeg:
            image = cv2.imdecode(np.frombuffer(self.encode(frame), np.uint8), cv2.IMREAD_COLOR)
        else:
            image = cv2.cvtColor(frame, cv2.COLOR_YCrCb2BGR)
        swapped, ordered = cv2.cvtColor(image, cv2.COLOR_BGR2YCrCb), np.empty_like(image)
        cv2.mixChannels([swapped], [ordered], [0, 0, 2, 1, 1, 2])
        return ordered
