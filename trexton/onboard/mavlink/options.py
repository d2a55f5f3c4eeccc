"""What can be chosen of the conversation with an autopilot; declared without pymavlink, for the
command line shows it before anybody flies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from trexton.base.errors import ParameterError
from trexton.base.options import Options, option
from trexton.base.progress import say
from trexton.onboard.settings import numbers

__all__ = ["COMPONENT", "MavlinkOptions"]

COMPONENT = 191  # MAV_COMP_ID_ONBOARD_COMPUTER: what we are on the vehicle's network
KEY_BYTES = 32
ORIGIN_LIMITS = ((-90.0, 90.0), (-180.0, 180.0), (-1000.0, 10_000.0))  # degrees, degrees, metres


@dataclass(frozen=True)
class MavlinkOptions(Options):
    """Autopilot over MAVLink"""

    autopilot: str = option(
        "px4", "whose messages are sent; ardupilot-gps stands for a receiver of satellites",
        choices=("px4", "ardupilot", "ardupilot-gps"),
    )  # fmt: skip
    send_yaw: bool = option(
        False, "send the yaw that frames show, for an autopilot that fuses it; takes method fine"
    )
    landing_target: bool = option(
        False, "send the centre of --land as LANDING_TARGET, for the autopilot's precision landing"
    )
    target: str | None = option(
        None, "our autopilot, SYS or SYS/COMP; needed where more than one vehicle is heard"
    )
    component_id: int = option(
        COMPONENT, "our own number on the vehicle, where another has this one", low=1, high=255
    )
    origin: str | None = option(
        None, "LAT,LON,ALT in degrees and metres: set as the autopilot's global origin"
    )
    sign_key: str | None = option(
        None, "file of 32 bytes: sign every message, and believe only what is signed with it"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        place, _ = self.place, self.addressee  # checked now, not in the air
        if self.autopilot == "ardupilot-gps" and place is None:
            raise ParameterError(
                "--autopilot ardupilot-gps sends places on Earth: add --origin LAT,LON,ALT"
            )

    @property
    def addressee(self) -> tuple[int | None, int | None]:
        """System and component of the target, None where not given; raises `ParameterError`."""
        if self.target is None:
            return None, None
        words = self.target.split("/")
        given = [int(word) for word in words if word.isdecimal() and 0 < int(word) < 256]
        if len(given) != len(words) or len(words) > 2:
            raise ParameterError(
                f"target {self.target!r}: expected SYS or SYS/COMP, each from 1 to 255, as in 1/1"
            )
        return given[0], given[1] if len(given) == 2 else None

    @property
    def place(self) -> tuple[float, float, float] | None:
        """The origin as numbers; raises `ParameterError`."""
        if self.origin is None:
            return None
        latitude, longitude, altitude = numbers("--origin LAT,LON,ALT", self.origin, (3,))
        for value, (low, high) in zip((latitude, longitude, altitude), ORIGIN_LIMITS, strict=True):
            if not low <= value <= high:
                raise ParameterError(
                    f"origin {self.origin}: {value:g} is not within {low:g} to {high:g}: "
                    "give latitude and longitude in degrees, altitude in metres"
                )
        return latitude, longitude, altitude

    def key(self) -> bytes | None:
        """The key to sign with; raises `ParameterError`."""
        if self.sign_key is None:
            return None
        try:
            path = Path(self.sign_key)
            key = path.read_bytes()
            if path.stat().st_mode & 0o077:
                say(f"{path}: others can read or write this key: chmod 600 {path}")
        except OSError as error:
            raise ParameterError(
                f"{self.sign_key}: the key cannot be read ({error.strerror})"
            ) from None
        if len(key) != KEY_BYTES:
            raise ParameterError(f"{self.sign_key}: {len(key)} bytes: a key has {KEY_BYTES}")
        return key
