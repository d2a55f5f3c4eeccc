"""What a photograph says of itself in EXIF and XMP: place, height, attitude and time. `read_shot`
reads a file, `missing_zones` names what times lack.
"""

import re
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.errors import FlightError
from trexton.flights.importers.axes import AXES, attitude_from_quaternions
from trexton.flights.tables import time_of

_GPS, _DETAILS = 0x8825, 0x8769  # EXIF directories
# When it was taken, when the file was changed, with the parts of a second and the zone of each.
_TAKEN = ((0x9003, 0x9291, 0x9011), (0x0132, 0x9290, 0x9010))
_PARTS = ("Yaw", "Pitch", "Roll")
_UNKNOWN = (np.nan, np.nan, np.nan)
# Heights above the place of take-off or the ground (DJI and Autel; senseFly, Parrot and Pix4D), and
# angles in degrees: what yaw, pitch and roll turn, as in `AXES`. At 0 a camera looks ahead or down.
_HEIGHTS = ("RelativeAltitude", "AboveGroundAltitude")
_AHEAD = np.array([[0.0, 0, -1], [1, 0, 0], [0, -1, 0]])
_ANGLES = (
    ("Gimbal{}Degree", _AHEAD),  # DJI, Autel
    ("Camera{}Degree", _AHEAD),  # Parrot
    ("Camera:{}", AXES["frd"]),  # senseFly, Pix4D
    ("Flight{}Degree", AXES["frd"]),  # of the vehicle, where the camera's are not given
    ("Drone{}Degree", AXES["frd"]),
)


@dataclass(frozen=True)
class Shot:
    """What is known of a photograph; NaN what is not. Its attitude is the camera's roll, pitch, yaw
    in radians; see `trexton.vision.camera`.
    """

    latitude: float = np.nan  # degrees
    longitude: float = np.nan  # degrees
    altitude: float = np.nan  # metres above the sea
    height: float = np.nan  # metres above the place of take-off, where the vehicle gave it
    attitude: tuple[float, float, float] = _UNKNOWN
    time_ns: int = 0  # nanoseconds since 1970; 0 where there is no time
    zoned: bool = False  # whether the zone of the time is known: else it is taken as UTC
    turned: int = 1  # by which turn it is to be shown, as EXIF numbers them; 1 is none


def read_shot(path: Path) -> Shot:
    """What EXIF and XMP tell; where they tell no place, the time alone."""
    from PIL import Image

    try:
        with Image.open(path) as image:
            exif, xmp = image.getexif(), image.info.get("xmp", b"")
            gps, details = exif.get_ifd(_GPS), exif.get_ifd(_DETAILS)
    except (KeyError, TypeError, ValueError, OSError, Image.DecompressionBombError):
        return Shot()
    taken, zone = 0, None
    for moment, part, offset in _TAKEN:
        known = next((table for table in (details, exif) if moment in table), None)
        if known is not None:
            text, digits = _text(known[moment]), re.match(r"\d+", _text(details.get(part, "")))
            zone = re.fullmatch(r"[-+]\d\d:?\d\d", _text(details.get(offset, "")))
            if len(text) == len("2013:06:04 13:37:29"):
                text += (f".{digits[0]}" if digits else "") + (zone[0] if zone else "")
            with suppress(FlightError):  # no time: as if the camera had no clock
                taken = time_of(path, text)
            break
    if _text(gps.get(9, "")).upper() == "V":  # the receiver had lost its fix
        gps = {}
    try:
        latitude, longitude = _degrees(gps[2], gps[1], "NS"), _degrees(gps[4], gps[3], "EW")
        altitude = float(gps[6]) * (-1 if gps.get(5) in (1, b"\x01") else 1) if 6 in gps else np.nan
    except (KeyError, TypeError, ValueError, ZeroDivisionError):
        latitude = longitude = altitude = np.nan
    values = _values(xmp if isinstance(xmp, bytes) else str(xmp).encode())
    height = next((values[name] for name in _HEIGHTS if name in values), np.nan)
    turned = exif.get(0x0112, 1)
    return Shot(latitude, longitude, altitude, height, _attitude(values), taken, bool(zone), turned)


def _text(value: Any) -> str:
    """Some cameras store the letters as bytes, or as a list of them."""
    if isinstance(value, (tuple, list)):
        value = bytes(each for each in value if isinstance(each, int) and 0 < each < 128)
    text = value.decode("latin-1") if isinstance(value, bytes) else str(value)
    return text.strip("\0 ")


def _degrees(parts: Any, side: Any, sides: str) -> float:
    """South and west are negative; raises `ValueError` where no side is given."""
    degrees, minutes, seconds = (float(part) for part in (*parts, 0, 0)[:3])
    value = degrees + minutes / 60 + seconds / 3600
    return (1, -1)[sides.index(_text(side).upper()[:1] or "?")] * value


def _values(xmp: bytes) -> dict[str, float]:
    """The numbers in XMP, of Parrot fractions, by their names without the maker."""
    text = xmp.decode("utf-8", "replace")
    number = r"([-+]?\d{1,9}(?:[.,]\d+)?(?:[eE][-+]?\d\d?)?)(?![\d.eE])(?:/(\d+))?"
    found = re.findall(rf"([\w-]+):(\w+)(?:\s*=\s*[\"']|>)\s*{number}", text)
    values = {}
    for space, name, above, below in found:
        if space == "Camera" or name not in _PARTS:
            known = f"Camera:{name}" if name in _PARTS else name
            values[known] = float(above.replace(",", ".")) / (float(below or 1) or np.nan)
    return values


def _attitude(values: dict[str, float]) -> tuple[float, float, float]:
    """Roll, pitch, yaw; a compass counts clockwise from north, where y points."""
    from scipy.spatial.transform import Rotation

    for name, axes in _ANGLES:
        yaw, pitch, roll = (values.get(name.format(part)) for part in _PARTS)
        if yaw is not None and pitch is not None:
            turn = Rotation.from_euler("ZYX", (yaw, pitch, roll or 0.0), degrees=True)
            turn = Rotation.from_matrix(AXES["frd"]) * turn  # of north, east and down
            axes = axes if pitch > -45 or ":" not in name else _AHEAD  # as Autel counts
            attitude = attitude_from_quaternions(turn.as_quat(), axes)[0]
            return float(attitude[0]), float(attitude[1]), float(attitude[2])
    return _UNKNOWN


def number_of(text: str) -> str:
    """A number of ``52 deg 5' 34.44" N`` or ``12 m Below Sea Level``; other texts as they are."""
    found = re.fullmatch(r"""([\d.]+) (deg|m)\b(?: ([\d.]+)' ([\d.]+)\")?(.*)""", text.strip())
    if found is None:
        return text
    degrees, _, minutes, seconds, side = found.groups()
    sign = -1 if side.strip()[:1] in ("S", "W", "B") else 1
    return str(sign * (float(degrees) + float(minutes or 0) / 60 + float(seconds or 0) / 3600))


def missing_zones(shots: dict[Path, Shot], fewest: int) -> list[str]:
    """A sentence where some have no time zone, beside at least so many that do."""
    missing = sum(not shot.zoned for shot in shots.values())
    said = f"{missing} of {len(shots)} photographs tell no time zone: their times are taken as UTC"
    said += ", give them EXIF's OffsetTimeOriginal where they are not"
    return [said] * (0 < missing <= len(shots) - fewest)
