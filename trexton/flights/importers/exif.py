"""What a photograph says of itself in EXIF and XMP: place, height, attitude and time.

`read_shot` reads a file; `time_of` reads a time as cameras write it.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import FlightError

_GPS, _DETAILS = 0x8825, 0x8769  # EXIF directories
# When it was taken, when the file was changed, and the parts of a second of each.
_TAKEN = ((0x9003, 0x9291), (0x0132, 0x9290))
_UNKNOWN = (np.nan, np.nan, np.nan)
# Heights above the place of take-off or the ground (DJI and Autel; senseFly, Parrot and Pix4D), and
# roll, pitch and yaw of the camera in degrees, with what makes of the pitch 0 straight down.
_HEIGHTS = ("RelativeAltitude", "AboveGroundAltitude")
_ANGLES = (
    (("GimbalRollDegree", "GimbalPitchDegree", "GimbalYawDegree"), 90.0),  # DJI, Autel
    (("CameraRollDegree", "CameraPitchDegree", "CameraYawDegree"), 90.0),  # Parrot
    (("Camera:Roll", "Camera:Pitch", "Camera:Yaw"), 0.0),  # senseFly, Pix4D
)


@dataclass(frozen=True)
class Shot:
    """What is known of a photograph.

    Attributes
    ----------
    latitude, longitude : float
        Degrees; NaN where there are none.
    altitude : float
        Metres above the sea.
    height : float
        Metres above the place of take-off, where the vehicle told it.
    attitude : (roll, pitch, yaw)
        Radians, of the camera; see `trexton.vision.camera`.
    time_ns : int
        Nanoseconds since 1970; 0 where there is no time.
    """

    latitude: float = np.nan
    longitude: float = np.nan
    altitude: float = np.nan
    height: float = np.nan
    attitude: tuple[float, float, float] = _UNKNOWN
    time_ns: int = 0

    @property
    def located(self) -> bool:
        return bool(np.isfinite([self.latitude, self.longitude]).all())

    @property
    def fixed(self) -> bool:
        """Whether it is not at 0, 0, where receivers put what has no fix."""
        return max(abs(self.latitude), abs(self.longitude)) > 1e-6


def read_shot(path: Path) -> Shot:
    """What EXIF and XMP tell; where they tell no place, the time alone.

    Raises
    ------
    FlightError
        Its time is none.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as image:
            exif, xmp = image.getexif(), image.info.get("xmp", b"")
            gps, details = exif.get_ifd(_GPS), exif.get_ifd(_DETAILS)
    except (
        KeyError, TypeError, ValueError, UnidentifiedImageError, OSError,
        Image.DecompressionBombError,
    ):  # fmt: skip
        return Shot()
    taken = 0
    for moment, part in _TAKEN:
        known = next((table for table in (details, exif) if moment in table), None)
        if known is not None:
            fraction = re.match(r"\d*", str(details.get(part, "")).strip())
            taken = time_of(path, _text(known[moment]), fraction[0] if fraction else "")
            break
    try:
        latitude, longitude = _degrees(gps[2], gps[1], "S"), _degrees(gps[4], gps[3], "W")
        altitude = float(gps[6]) * (-1 if gps.get(5) in (1, b"\x01") else 1) if 6 in gps else np.nan
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        latitude = longitude = altitude = np.nan
    values = _values(xmp if isinstance(xmp, bytes) else str(xmp).encode())
    height = next((values[name] for name in _HEIGHTS if name in values), np.nan)
    return Shot(latitude, longitude, altitude, height, _attitude(values), taken)


def _text(value: Any) -> str:
    """Some cameras store the letters as bytes, or as a list of them."""
    if isinstance(value, (tuple, list)):
        value = bytes(each for each in value if isinstance(each, int) and 0 < each < 128)
    text = value.decode("latin-1") if isinstance(value, bytes) else str(value)
    return text.strip("\0 ")


def _degrees(parts: Any, side: Any, negative: str) -> float:
    degrees, minutes, seconds = (float(part) for part in parts)
    value = degrees + minutes / 60 + seconds / 3600
    return -value if _text(side).upper().startswith(negative) else value


def _values(xmp: bytes) -> dict[str, float]:
    """The numbers in XMP by their names without the maker, as attributes or elements."""
    text = xmp.decode("utf-8", "replace")
    found = re.findall(r"([\w-]+):(\w+)(?:\s*=\s*[\"']|>)\s*([-+]?\d+(?:\.\d+)?)", text)
    return {
        f"Camera:{name}" if name in ("Roll", "Pitch", "Yaw") else name: float(value)
        for space, name, value in found
        if space == "Camera" or name not in ("Roll", "Pitch", "Yaw")
    }


def _attitude(values: dict[str, float]) -> tuple[float, float, float]:
    """Roll, pitch, yaw; a compass counts clockwise from north, where y points."""
    for names, level in _ANGLES:
        if all(name in values for name in names[1:]):
            roll, pitch, yaw = (values.get(name, 0.0) for name in names)
            if abs(pitch + level) < 5 and abs(abs(roll) - 180) < 1:
                roll, yaw = 0.0, yaw + 180  # a gimbal turned over, which looks down as well
            return np.radians(roll), np.radians(pitch + level), -np.radians(yaw)
    return _UNKNOWN


def time_of(path: Path, text: str, fraction: str = "") -> int:
    """Nanoseconds since 1970 of an EXIF time such as ``2013:06:04 13:37:29``, or one of ISO 8601.

    It is taken as UTC where it tells no zone; zero where a camera without a clock wrote it. An
    hour 24 is that after midnight of the same date, as phones mean it.

    Parameters
    ----------
    fraction : str
        Digits behind the seconds.

    Raises
    ------
    FlightError
        It is no time, or beyond the year 2262.
    """
    if not text.strip(" 0:"):
        return 0
    try:
        date, clock = text.strip()[:10], re.sub(r"^(\D)24:", r"\g<1>00:", text.strip()[10:])
        moment = datetime.fromisoformat(date.replace(":", "-") + clock)
        moment = moment if moment.tzinfo else moment.replace(tzinfo=UTC)
        stamp = round(moment.timestamp() * 1e6) * 1000
        stamp += int(f"{fraction:0<9}"[:9]) if fraction else 0
        if abs(stamp) < 2**63:
            return stamp
    except ValueError:
        pass
    raise FlightError(f"{path}: {text[:40]!r} is no time: expected one such as 2013:06:04 13:37:29")
