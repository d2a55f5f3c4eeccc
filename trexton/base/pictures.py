"""Pictures that others wrote, decoded without trust: what they declare is looked at first. Offers
`decode` and `declared_size`."""

import cv2
import numpy as np

MOST_PIXELS = 50_000_000
MOST_BYTES = 2**28  # of a file, and of all pictures of a record
_PNG = b"\x89PNG\r\n\x1a\n"


def declared_size(data: bytes) -> tuple[int, int] | None:
    """Width and height that the head of a PNG, BMP or JPEG file declares; None if not found."""
    if data.startswith(_PNG):
        return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")
    if data[:2] == b"BM":
        width, height = (int.from_bytes(data[i : i + 4], "little", signed=True) for i in (18, 22))
        return abs(width), abs(height)
    place = 2
    while data[:2] == b"\xff\xd8" and place + 9 < len(data) and data[place] == 0xFF:
        kind, length = data[place + 1], int.from_bytes(data[place + 2 : place + 4], "big")
        if 0xC0 <= kind <= 0xCF and kind not in (0xC4, 0xC8, 0xCC):
            height, width = (int.from_bytes(data[place + i : place + i + 2], "big") for i in (5, 7))
            return width, height
        place += 1 if kind == 0xFF else 2 + length
    return None


def decode(data: bytes, flags: int = cv2.IMREAD_COLOR) -> np.ndarray | None:
    """The picture in a file's bytes (BGR); None where OpenCV cannot, or too much is declared."""
    width, height = declared_size(data) or (0, 0)
    if not data or width * height > MOST_PIXELS or _is_cut(data):
        return None
    try:
        return cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error:
        return None


def _is_cut(data: bytes) -> bool:
    """Whether a chunk of a PNG is longer than the file: OpenCV would first get memory for it."""
    if not data.startswith(_PNG):
        return False
    place = len(_PNG)
    while place < len(data) and data[place + 4 : place + 8] != b"IEND":
        place += 12 + int.from_bytes(data[place : place + 4], "big")
    return place >= len(data)
