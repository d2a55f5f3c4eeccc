"""Everything that can be chosen, declared once. The command line is made from these classes."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

from trexton.base.defaults import SAMPLES
from trexton.base.errors import ParameterError
from trexton.base.files import read_bytes
from trexton.base.options import Options, option
from trexton.base.progress import say
from trexton.base.streams import MOST_SEED
from trexton.localization.landing import LandingZone, TouchdownZone
from trexton.onboard.fix import LocalFrame
from trexton.onboard.intake import AIDS

KEY_BYTES = 32
COMPONENT = 191  # MAV_COMP_ID_ONBOARD_COMPUTER: what we are on the vehicle's network
ORIGIN_LIMITS = ((-89.9, 89.9), (-180.0, 180.0), (-1000.0, 10_000.0))  # degrees, metres; no pole
CONSECUTIVE = 3  # estimates in a row that must lie inside
LONGEST_DELAY = 0.4  # seconds: not much longer, and every position is stale when it is sent
T = TypeVar("T", bound=Options)


@dataclass(frozen=True)
class Flying(Options):
    """What is flown"""

    camera: str = option("/dev/video0", "where frames come from")
    log: str | None = option(None, "file for every position, fault and answer, as JSON lines")
    camera_delay: float = option(
        0.0,
        "seconds by which a live camera's frames are old when they arrive; --preflight finds it",
        low=0,
        high=LONGEST_DELAY,
    )
    rate: float | None = option(
        None, "frames a second; the map's own unless given", low=0.01, high=1000
    )
    samples: int = option(SAMPLES, "patches drawn a frame, 0 for all", low=0)
    particles: int | None = option(None, "particles of the filter", low=1)
    method: str | None = option(None, "another method than the map was trained for")
    seed: int = option(1, "of everything that is drawn", low=0, high=MOST_SEED)
    frames: int | None = option(None, "stop after so many frames", low=1)
    aiding: str = option(
        "tilt",
        "what the autopilot or a recording may tell: roll, pitch and height; all of it, yaw and "
        "velocity too; none",
        choices=AIDS,
    )


@dataclass(frozen=True)
class MapPlacement(Options):
    """How the map lies"""

    heading: float | None = option(
        None, "compass heading of the map's +y, degrees; north unless given", low=-360, high=360
    )
    height: float = option(1.0, "flying height in metres, sent as it is given", low=0.01, high=1000)

    @property
    def local(self) -> LocalFrame:
        """The map's place in the autopilot's axes."""
        return LocalFrame(math.radians(self.heading or 0.0), self.height)


@dataclass(frozen=True)
class Landing(Options):
    """Landing"""

    land: str | None = option(None, "X,Y of the landing zone's centre on the map, metres")
    radius: float = option(0.6, "its radius in metres")
    trigger: str = option(
        "inside",
        "what permits it: a position inside, as in the paper, or a touchdown that will probably be",
        choices=("inside", "touchdown"),
    )
    spread: str = option("0.6", "largest spread of a position inside, metres, one number or X,Y")
    arm_landing: bool = option(False, "command the landing; without it, it is only said")
    allow_overconfident: bool = option(
        False, "land though the map's 90 % region held too few of its own flight's positions"
    )

    def zone(self, area: tuple[float, float, float, float]) -> LandingZone | None:
        """The zone on a map of this area; raises `ParameterError` where it lies outside."""
        if self.land is None:
            for each in self.declared():
                if getattr(self, each.name) != each.default:
                    raise ParameterError(
                        f"{self.flag(each.name)} is given without --land: say where, as in "
                        "--land 2.5,2.5"
                    )
            return None
        x, y = _numbers("--land", self.land, (2,))
        spread = _numbers("--spread", self.spread, (1, 2))
        x_min, x_max, y_min, y_max = area
        if not (x_min <= x <= x_max and y_min <= y <= y_max):
            raise ParameterError(
                f"--land {self.land}: outside the map, which reaches from x {x_min:g} to "
                f"{x_max:g} m and y {y_min:g} to {y_max:g} m: give a place on it"
            )
        if self.trigger == "touchdown":
            if self.spread != Landing.spread:
                raise ParameterError("--spread is of --trigger inside: leave one of them out")
            return TouchdownZone((x, y), self.radius)
        return LandingZone((x, y), self.radius, spread, CONSECUTIVE)


def _numbers(flag: str, text: str, counts: tuple[int, ...]) -> tuple[float, ...]:
    """Finite numbers with commas between; raises `ParameterError` for another count of them."""
    try:
        values = tuple(float(part) for part in text.split(","))
    except ValueError:
        values = ()
    if len(values) not in counts or not all(map(math.isfinite, values)):
        expected = " or ".join(map(str, counts))
        raise ParameterError(f"{flag} {text!r}: expected {expected} numbers with commas between")
    return values


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
        COMPONENT, "our own number on the vehicle, where another has this one", low=2, high=255
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
        latitude, longitude, altitude = _numbers("--origin LAT,LON,ALT", self.origin, (3,))
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
        path = Path(self.sign_key)
        key = read_bytes(path, KEY_BYTES, "the key to sign with", ParameterError)
        if path.stat().st_mode & 0o077:
            say(f"{path}: others can read or write this key: chmod 600 {path}")
        if len(key) != KEY_BYTES:
            raise ParameterError(f"{path}: {len(key)} bytes: a key has {KEY_BYTES}")
        return key


@dataclass(frozen=True)
class Settings:
    """A flight of the script."""

    map: str  # file of the texton map
    outputs: tuple[str, ...] = ()  # see `trexton.onboard.sinks`
    choices: tuple[str, ...] = ()  # ``role=part``, ``role.option=value``
    # an object for each class that differs from its defaults, those of sinks and sources too
    options: Mapping[type[Options], Any] = field(default_factory=dict)

    def of(self, kind: type[T]) -> T:
        """The options of one class."""
        return self.options.get(kind) or kind()
