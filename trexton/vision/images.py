"""Images as the method sees them: ``(H, W, 3) uint8`` arrays of Y, U, V (full-range BT.601, as in
JPEG).

The camera delivers 4:2:2 UYVY; a file is decoded by OpenCV to BGR. Both end in the same
representation here. Patches of P x P pixels are cut from it; their position is the (row, column) of
the top left corner.
"""

import os
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from trexton.base.errors import ImageError
from trexton.base.options import whole
from trexton.base.pictures import MOST_BYTES, MOST_PIXELS, TIFF, damage, declared_size, decode
from trexton.base.streams import generator

MOST_SAMPLES = 1_000_000  # three times all patches of 640x480: more only fill the memory


def check_image(image: np.ndarray) -> np.ndarray:
    """Return `image` if it is an ``(H, W, 3) uint8`` array; raise `ImageError` otherwise."""
    found = type(image).__name__
    if isinstance(image, np.ndarray):
        if image.ndim == 3 and image.shape[2] == 3 and image.dtype == np.uint8:
            return image
        found = f"{image.dtype} array of shape {image.shape}"
    raise ImageError(
        f"an image is an (H, W, 3) uint8 array of Y, U, V, found {found}: convert it with "
        "trexton.vision.images"
    )


def _swap_chroma(image: np.ndarray) -> np.ndarray:
    swapped = np.empty_like(image)
    cv2.mixChannels([image], [swapped], [0, 0, 1, 2, 2, 1])  # unlike split, no plane to fill
    return swapped


def yuv_from_bgr(image: np.ndarray) -> np.ndarray:
    """``(H, W, 3) uint8`` BGR to Y, U, V."""
    return _swap_chroma(cv2.cvtColor(check_image(image), cv2.COLOR_BGR2YCrCb))


def bgr_from_yuv(image: np.ndarray) -> np.ndarray:
    """``(H, W, 3) uint8`` Y, U, V to BGR."""
    return cv2.cvtColor(_swap_chroma(check_image(image)), cv2.COLOR_YCrCb2BGR)


def checked_bytes(path: Path) -> bytes:
    """The bytes of an image file; raises `ImageError` where it is missing, no regular file, or
    larger than a camera's picture can be: it declares more than `MOST_PIXELS`.
    """
    from trexton.base.files import read_bytes

    data = read_bytes(path, MOST_BYTES, "an image", ImageError)
    _check_size(path, declared_size(data) or (0, 0))
    return data


def _check_size(source: object, size: tuple[float, float]) -> None:
    if size[0] * size[1] > MOST_PIXELS:
        raise ImageError(
            f"{source}: declares {size[0]:.0f}x{size[1]:.0f} pixels: "
            f"expected at most {MOST_PIXELS:,}, shrink it"
        )


def check_capture(capture: Any, source: object) -> None:
    """Refuse an opened video whose frames are larger than a camera's picture can be, of more than
    `MOST_PIXELS`, by an `ImageError`.
    """
    width, height = cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT
    _check_size(source, (capture.get(width), capture.get(height)))


def read_picture(path: str | os.PathLike[str]) -> tuple[np.ndarray, np.ndarray | None] | None:
    """``(H, W, 3) uint8`` BGR of a picture file, turned as its EXIF says, and ``(H, W)`` bool where
    it is not transparent, None where it has no alpha channel; None where it cannot be decoded.
    Raises `ImageError` where it is damaged, and as `checked_bytes` does.
    """
    data = checked_bytes(Path(path))
    if found := damage(data):
        raise ImageError(f"{path}: {found}: give it anew")
    whole = decode(data, cv2.IMREAD_UNCHANGED)
    if whole is None or whole.ndim == 2 or whole.shape[2] != 4:
        # As OpenCV shows it: grey becomes BGR, 16 bits become 8, and only this turns by EXIF.
        picture = decode(data)
        return None if picture is None else (picture, None)
    if whole.dtype == np.uint16:
        whole = (whole // 257).astype(np.uint8)
    return np.ascontiguousarray(whole[..., :3]), whole[..., 3] > 0


def read_image(path: str | os.PathLike[str]) -> np.ndarray:
    """Read an image file as ``(H, W, 3) uint8`` Y, U, V; raises `ImageError` where it is missing,
    is no image, is damaged, or holds several.
    """
    path = Path(path)
    data = checked_bytes(path)
    try:
        return decode_image(data)
    except ImageError as error:
        raise ImageError(f"{path}: {error}: record or copy it again") from None


def size_of(file: Path) -> tuple[int, int]:
    """Width and height of an image as it is read, by an eighth of it: in a fifth of the time."""
    data = checked_bytes(file)
    small, declared = decode(data, cv2.IMREAD_REDUCED_GRAYSCALE_8), declared_size(data)
    if damage(data) or small is None or declared is None or small.shape[0] == small.shape[1]:
        height, width = read_image(file).shape[:2]
        return width, height
    wide = small.shape[1] > small.shape[0]  # as it is turned by EXIF
    return (max(declared), min(declared)) if wide else (min(declared), max(declared))


def decode_image(data: bytes) -> np.ndarray:
    """``(H, W, 3) uint8`` Y, U, V of the bytes of an image file; raises `ImageError` where they are
    no image, are damaged, or hold several.
    """
    fault = damage(data)
    image = None if fault else decode(data)
    if image is None:
        fault = fault or "not an image that OpenCV can decode"
        if data[:3] in TIFF and "decode" in fault:
            fault += " (a TIFF of over four bands, or of floats? write one band of 8 or 16 bits)"
        raise ImageError(f"{fault} ({len(data)} bytes)")
    return yuv_from_bgr(image)


def natural_order(path: Path) -> list[tuple[int, str]]:
    """Sort key in the order in which people count: IMG_9 before IMG_10."""
    parts = re.split(r"(\d+)", path.name)
    return [(int(part), "") if part.isdecimal() else (0, part) for part in parts]


def position_grid(shape: tuple[int, ...], patch: int) -> tuple[int, int]:
    """How many rows and columns of positions an image of `shape` has: (H - P + 1, W - P + 1);
    raises `ImageError` where it is smaller than a patch.
    """
    rows, columns = shape[0] - patch + 1, shape[1] - patch + 1
    if rows < 1 or columns < 1:
        raise ImageError(
            f"the image has {shape[1]}x{shape[0]} pixels, a patch {patch}x{patch}: give a larger "
            "image"
        )
    return rows, columns


def sample_positions(
    shape: tuple[int, ...], patch: int, n: int, rng: np.random.Generator
) -> np.ndarray:
    """``(n, 2) int64``: random positions, uniform over an image of `shape`, with replacement."""
    rows, columns = position_grid(shape, patch)
    n, rng = whole(n, "the number of samples", 1, MOST_SAMPLES), generator(rng)
    positions = np.empty((2, n), dtype=np.int64)
    np.divmod(rng.integers(rows * columns, size=n), columns, out=(positions[0], positions[1]))
    return positions.T


def gather_patches(image: np.ndarray, positions: np.ndarray, patch: int) -> np.ndarray:
    """``(N, P, P, 3) uint8``: the patches at `positions` ``(N, 2)``; the image is not copied."""
    rows, columns = position_grid(check_image(image).shape, patch)
    image = np.ascontiguousarray(image)
    # One item is a whole row of a patch, 3 P neighbouring bytes.
    line = image.strides[0]
    windows = np.ndarray((rows, columns, patch), f"V{3 * patch}", image, strides=(line, 3, line))
    return windows[positions[:, 0], positions[:, 1]].view(np.uint8).reshape(-1, patch, patch, 3)


def draw_patches(
    images: Iterable[np.ndarray], patch: int, per_image: int, rng: np.random.Generator
) -> np.ndarray:
    """``(N, P, P, 3) uint8``: `per_image` random patches, with replacement, from each image."""
    drawn = [
        gather_patches(image, sample_positions(image.shape, patch, per_image, rng), patch)
        for image in images
    ]
    return np.concatenate(drawn) if drawn else np.empty((0, patch, patch, 3), np.uint8)
