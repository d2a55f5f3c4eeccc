"""Pictures that others wrote, decoded without trust: what they declare is looked at first. Offers
`decode`, `damage` and `declared_size`."""

import re

import cv2
import numpy as np
from simplejpeg import decode_jpeg, decode_jpeg_header

MOST_PIXELS = 50_000_000
MOST_BYTES = 2**28  # of a file, and of all pictures of a record
TIFF = b"II*", b"MM\0"
_PADDING = 8  # bytes that a webcam may leave before the end of a JPEG
_PNG = b"\x89PNG\r\n\x1a\n"


def declared_size(data: bytes) -> tuple[int, int] | None:
    """Width and height that the head of a PNG, BMP or JPEG file declares; None if not found."""
    if data.startswith(_PNG):
        return int.from_bytes(data[16:20], "big"), int.from_bytes(data[20:24], "big")
    if data[:2] == b"BM":
        width, height = (int.from_bytes(data[i : i + 4], "little", signed=True) for i in (18, 22))
        return abs(width), abs(height)
    try:
        height, width, *_ = decode_jpeg_header(data)
        return width, height
    except ValueError:
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


def damage(data: bytes) -> str:
    """What OpenCV passes over without a word: a damaged JPEG, whose rest becomes grey, and all but
    the first page of a TIFF. Empty where there is nothing of both.
    """
    if data[:2] == b"\xff\xd8":
        try:  # all is decoded, but pixels are made for an eighth of the size only
            decode_jpeg(data, "GRAY", min_height=1, min_width=1, min_factor=8)
        except ValueError as error:
            padding = re.search(r"data: (\d+) extraneous bytes", str(error))
            whole = padding and int(padding[1]) <= _PADDING or "conversion" in str(error)
            return "" if whole else f"the file is cut short or damaged ({error})"
    elif data[:3] in TIFF:  # of an overview or a mask the shape is another
        buffer = np.frombuffer(data, np.uint8)
        pages = cv2.imdecodemulti(buffer, cv2.IMREAD_UNCHANGED, range=(0, 2))[1]
        if len(pages) == 2 and pages[0].shape == pages[1].shape:
            return "the file holds several pages, an image is one (write a file of each)"
    return ""


def _is_cut(data: bytes) -> bool:
    """Whether a chunk of a PNG is longer than the file: OpenCV would first get memory for it."""
    if not data.startswith(_PNG):
        return False
    place = len(_PNG)
    while place < len(data) and data[place + 4 : place + 8] != b"IEND":
        place += 12 + int.from_bytes(data[place : place + 4], "big")
    return place >= len(data)
