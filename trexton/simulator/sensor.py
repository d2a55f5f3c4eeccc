"""The image sensor turns light to bytes, in integers, so that equal scenes give equal frames
everywhere. Offers `Sensor`, and `Effects`: what stands between a perfect picture of the floor and
a camera's frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np

from trexton.base.options import Options, option
from trexton.vision.camera import Camera
from trexton.vision.images import decode_image, yuv_from_bgr
from trexton.vision.kernels import compiled

_ONE = 12  # fractional bits of gains
_NOISE = 8  # fractional bits of the noise and of its strength; every product stays within 32 bits
_SPARE = 256  # the noise tile is this much larger than the frame, so that it can be shifted

_int = np.int32
_HALF = _int(1 << (_ONE - 1))
_HALF_NOISE = _int(1 << (2 * _NOISE - 1))


@dataclass(frozen=True)
class Effects(Options):
    """Strength of each effect, 0 for off; the defaults are those of a small quadrotor indoors."""

    roll_pitch: float = option(1.0, "share of the tilt that the camera sees", low=0, high=1)
    yaw: float = option(0.03, "deviation of the heading in radians", low=0, high=0.5)
    height_ripple: float = option(0.03, "deviation of the height in metres", low=0, high=0.2)
    motion_blur: float = option(0.010, "exposure in seconds: motion smears", low=0, high=0.04)
    rolling_shutter: float = option(0.025, "seconds from first to last row", low=0, high=0.08)
    exposure: float = option(0.02, "deviation of slow changes of gain (share)", low=0, high=0.3)
    vignetting: float = option(0.25, "share of light lost in the corners", low=0, high=0.9)
    noise: float = option(2.5, "deviation of noise at mid grey, in grey levels", low=0, high=25)
    chroma_subsampling: float = option(1.0, "1: two pixels share U and V (4:2:2)", low=0, high=1)
    jpeg: float = option(92.0, "quality of JPEG files; off: lossless PNG", low=0, high=100)

    def without(self, *names: str) -> Effects:
        """These effects switched off, the others as they are."""
        return replace(self, **self.checked(dict.fromkeys(names, 0.0), "a camera"))


@compiled()
def _develop(
    planes, gain, vignette, noise, top, left, base, slope, share_chroma
):  # pragma: no cover - compiled
    """Gain, vignette, noise and shared chroma, in place, for ``(3, H, W) uint8`` Y, Cr, Cb."""
    _, height, width = planes.shape
    factor, strength = np.empty(width, np.int32), np.empty(width, np.int32)
    for v in range(height):
        row, drawn = planes[0, v], noise[0, v + top, left : left + width]
        for u in range(width):
            factor[u] = (_int(gain) * vignette[v, u] + _HALF) >> _int(_ONE)
            light = min(_int(255), (_int(row[u]) * factor[u] + _HALF) >> _int(_ONE))
            strength[u] = _int(base) + ((_int(slope) * light) >> _int(7))
            light += (drawn[u] * strength[u] + _HALF_NOISE) >> _int(2 * _NOISE)
            row[u] = min(_int(255), max(_int(0), light))
        for channel in range(1, 3):
            row, drawn = planes[channel, v], noise[channel, v + top, left : left + width]
            for u in range(width):
                color = ((_int(row[u]) - _int(128)) * factor[u] + _HALF) >> _int(_ONE)
                color += (drawn[u] * strength[u] + _int(2) * _HALF_NOISE) >> _int(2 * _NOISE + 1)
                row[u] = min(_int(255), max(_int(0), _int(128) + color))
            if share_chroma:
                for pair in range(width // 2):
                    shared = (_int(row[2 * pair]) + _int(row[2 * pair + 1]) + _int(1)) >> _int(1)
                    row[2 * pair] = row[2 * pair + 1] = shared


class Sensor:
    """Turns scenes into frames.

    Vignetting, noise, chroma subsampling and JPEG of the `effects` are the sensor's. Its noise is
    drawn once; each frame sees another part of it.
    """

    def __init__(self, camera: Camera, effects: Effects, rng: np.random.Generator):
        self._effects = effects
        shape = (camera.height, camera.width)
        center_x, center_y = camera.principal_point
        squared = (np.arange(camera.width) - center_x) ** 2 + (
            np.arange(camera.height)[:, None] - center_y
        ) ** 2
        loss = effects.vignetting * squared / squared.max()
        self._vignette = np.rint((1 - loss) * 2**_ONE).astype(np.int32)
        tile = rng.standard_normal((3, shape[0] + _SPARE, shape[1] + _SPARE), dtype=np.float32)
        self._noise = np.rint(np.clip(tile, -8, 8) * 2**_NOISE).astype(np.int32)
        # Photons arrive one by one, so noise grows with the light, on top of what reading out adds.
        self._base, self._slope = (
            round(share * effects.noise * 2**_NOISE) for share in (0.55, 0.45)
        )

    @staticmethod
    def draw_offset(rng: np.random.Generator) -> tuple[int, int]:
        """Which part of the noise a frame sees; even columns, as two pixels may share chroma."""
        return int(rng.integers(_SPARE)), 2 * int(rng.integers(_SPARE // 2))

    def develop(self, scene: np.ndarray, gain: float, offset: tuple[int, int]) -> np.ndarray:
        """``(H, W, 3) uint8`` Y, Cr, Cb as the sensor delivers it."""
        planes = np.empty((3, *scene.shape[:2]), np.uint8)
        cv2.split(scene, list(planes))
        gain, share = round(gain * 2**_ONE), self._effects.chroma_subsampling > 0
        strengths = (self._base, self._slope, share)
        _develop(planes, gain, self._vignette, self._noise, *offset, *strengths)
        return cv2.merge(list(planes))

    def encode(self, frame: np.ndarray) -> tuple[bytes, str]:
        """A developed frame as the bytes of a JPEG file, or PNG where JPEG is off; the suffix."""
        image = cv2.cvtColor(frame, cv2.COLOR_YCrCb2BGR)
        if not self._effects.jpeg:
            quick = [cv2.IMWRITE_PNG_COMPRESSION, 1]
            return cv2.imencode(".png", image, quick)[1].tobytes(), ".png"
        shared = self._effects.chroma_subsampling > 0
        factors = cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_422
        quality = [cv2.IMWRITE_JPEG_QUALITY, round(self._effects.jpeg)]
        options = [*quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, factors[shared]]
        return cv2.imencode(".jpg", image, options)[1].tobytes(), ".jpg"

    def deliver(self, frame: np.ndarray) -> np.ndarray:
        """A developed frame as Y, U, V, exactly as it is read back from the file of `encode`."""
        if self._effects.jpeg:
            return decode_image(self.encode(frame)[0])
        return yuv_from_bgr(cv2.cvtColor(frame, cv2.COLOR_YCrCb2BGR))
