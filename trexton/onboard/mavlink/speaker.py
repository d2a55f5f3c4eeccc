"""What is to be said to an autopilot, when, and how PX4 and ArduPilot want it. No clock, no wire.

Times are seconds of the clock that stamps fixes. All of it is called under the sink's lock.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np

from trexton.onboard.fix import STALE_AFTER, Fix
from trexton.onboard.local import LocalFrame
from trexton.onboard.mavlink import messages
from trexton.onboard.mavlink.listener import Listener
from trexton.onboard.mavlink.messages import odometry, quality, vision_position

__all__ = ["PROFILES", "ArduPilot", "Profile", "Px4", "Speaker"]

REQUEST_PAUSE = 2.0
ORIGIN_ATTEMPTS = 10
REPEAT_TIMEOUT = STALE_AFTER  # seconds from capture for which a position is repeated
ATTITUDE_RATE = 20.0
STATE_RATE = 2.0
MIN_STAMP_STEP = 1e-3  # stamps of successive messages differ by at least this


@dataclass(frozen=True)
class Profile:
    """One autopilot's manner.

    Attributes
    ----------
    local : LocalFrame
    area : (x_min, x_max, y_min, y_max)
    """

    local: LocalFrame
    area: tuple[float, float, float, float]

    repeat_rate = 0.0  # messages a second, by repeating; 0 sends each position once
    unset = 0.0  # what stands in a command for "choose yourself"
    needs_attitude = False

    def position(self, fix: Fix, stamp_us: int, covariance: np.ndarray, attitude: Any) -> Any:
        """The message for a usable fix."""
        raise NotImplementedError

    def failed(self, fix: Fix, stamp_us: int, attitude: Any) -> Any:
        """The message that says there is no position, or None where silence says it."""
        return None


class Px4(Profile):
    """VISION_POSITION_ESTIMATE at a steady 30 Hz; silence, which ends its fusion, for no
    position."""

    name = "px4"
    repeat_rate = 30.0
    unset = math.nan

    def position(self, fix: Fix, stamp_us: int, covariance: np.ndarray, attitude: Any) -> Any:
        """The message for a usable fix."""
        return vision_position(
            stamp_us, fix.fusion.position, covariance, attitude, self.local, fix.resets
        )


class ArduPilot(Profile):
    """ODOMETRY, once an estimate, with a quality: -1 while there is no position."""

    name = "ardupilot"
    needs_attitude = True

    def position(self, fix: Fix, stamp_us: int, covariance: np.ndarray, attitude: Any) -> Any:
        """The message for a usable fix."""
        grade = quality(np.sqrt(np.diagonal(fix.covariance)), self.area)
        return odometry(
            stamp_us, fix.fusion.position, covariance, attitude, self.local, fix.resets, grade
        )

    def failed(self, fix: Fix, stamp_us: int, attitude: Any) -> Any:
        """The filter's position, marked as failed."""
        return odometry(
            stamp_us, fix.position, fix.covariance, attitude, self.local, fix.resets, -1
        )


PROFILES: dict[str, type[Profile]] = {"px4": Px4, "ardupilot": ArduPilot}


class Speaker:
    """What to say to an autopilot, and when.

    Parameters
    ----------
    profile : Profile
    motion_rate : (2, 2) array
        Covariance that the motion model adds in a second, square metres.
    listener : Listener
        Knows to whom, and what was answered.
    origin : (latitude, longitude, altitude) or None
        Set as the autopilot's global origin until it confirms it; after `ORIGIN_ATTEMPTS` in vain
        it is said, and given up. An autopilot that has started anew gets it again.
    aiding : {"tilt", "all", "none"}
        What it is asked for beside its attitude: height, and for all its velocity too.
    """

    def __init__(
        self,
        profile: Profile,
        motion_rate: np.ndarray,
        listener: Listener,
        origin: tuple[float, float, float] | None = None,
        *,
        aiding: str = "none",
    ):
        self.profile, self.listener = profile, listener
        self._motion_rate, self._wanted_origin, self._origin = motion_rate, origin, origin
        self._boots = listener.boots
        self._asked = {
            "none": {},
            "tilt": {"height": messages.HEIGHT},
            "all": {"height": messages.HEIGHT, "velocity": messages.VELOCITY},
        }[aiding]
        self.withheld = 0
        self._commands: deque[Any] = deque()
        self._fix: Fix | None = None  # the latest usable one that an image went into
        self._failed: Fix | None = None
        self._sent = 0  # times it has been sent
        self._next_at = -np.inf  # when the steady rate asks for the next position
        self._last_stamp = -np.inf
        self._due: dict[str, float] = {}
        self._origin_attempts = 0

    def tell(self, fix: Fix, now: float) -> None:
        """Take in a new fix. A prediction is no measurement: only what an image went into is passed
        on."""
        if not fix.usable:
            self._fix, self._failed = None, fix if fix.finite else None
        elif fix.observed:
            self._fix, self._failed = fix, None
        else:
            return
        self._sent = 0

    def land(self, confirmation: int, now: float) -> bool:
        """Put a landing command out; False while nobody is there, or it is in doubt who obeys."""
        listener = self.listener
        if listener.target is None or not (listener.present(now) and listener.certain):
            return False
        self._commands.append(messages.land(listener.target, confirmation, self.profile.unset))
        return True

    def forget_commands(self) -> None:
        """The link is gone: what was commanded here and now must not go out there and then."""
        self._commands.clear()

    def due(self, now: float) -> list[Any]:
        """The messages to send now."""
        out = [*self._commands]
        self._commands.clear()
        out += [
            messages.timesync_reply(request, round(1e9 * now))
            for request in self.listener.timesyncs
        ]
        self.listener.timesyncs.clear()
        if self._is_due("heartbeat", now, 1.0):
            out.append(messages.heartbeat())
        target = self.listener.target
        if target is not None:
            out += self._requests(target, now)
        position = self._position(now)
        return out if position is None else [*out, position]

    def next_due(self, now: float) -> float:
        """Seconds until something may be due again."""
        wait = self._due.get("heartbeat", now) - now
        if self._fix is not None and self.profile.repeat_rate:
            wait = min(wait, self._next_at - now)
        return max(0.0, wait)

    def _requests(self, target: tuple[int, int], now: float) -> list[Any]:
        out = []
        if self._boots != self.listener.boots:
            self._boots, self._due = self.listener.boots, {}
            self._origin, self._origin_attempts = self._wanted_origin, 0
        if self._origin is not None and self._is_due("origin", now, REQUEST_PAUSE):
            out += self._ask_for_origin(target, self._origin, now)
        if self.listener.attitude(now) is None and self._is_due("attitude", now, REQUEST_PAUSE):
            out.append(messages.interval_request(target, messages.ATTITUDE, ATTITUDE_RATE))
        if self.listener.on_ground(now) is None and self._is_due("state", now, REQUEST_PAUSE):
            out.append(messages.interval_request(target, messages.LANDED_STATE, STATE_RATE))
        aiding = self.listener.aiding(now) if self._asked else None
        for name, message in self._asked.items():
            if getattr(aiding, name) is None and self._is_due(name, now, REQUEST_PAUSE):
                out.append(messages.interval_request(target, message, ATTITUDE_RATE))
        return out

    def _ask_for_origin(
        self, target: tuple[int, int], origin: tuple[float, float, float], now: float
    ) -> list[Any]:
        confirmed = self.listener.origin
        if confirmed is not None and np.allclose(confirmed, origin[:2], rtol=0, atol=1e-5):
            self._origin = None  # ours is set: the same to within a metre or so
            return []
        self._origin_attempts += 1
        if self._origin_attempts >= ORIGIN_ATTEMPTS:
            self._origin = None
            self.listener.news.append(
                {"event": "origin not confirmed", "attempts": ORIGIN_ATTEMPTS}
            )
        return [messages.origin(target[0], *origin, round(1e6 * now))]

    def _is_due(self, what: str, now: float, pause: float) -> bool:
        if now < self._due.get(what, -np.inf):
            return False
        self._due[what] = now + pause
        return True

    def _position(self, now: float) -> Any | None:
        """The position message that is due, if one is."""
        if self._fix is not None and now - self._fix.time > REPEAT_TIMEOUT:
            self._fix = None  # old is never taken for fresh
        fix, rate = self._fix or self._failed, self.profile.repeat_rate
        if fix is None or (now < self._next_at if rate else self._sent):
            return None
        attitude = self.listener.attitude(fix.time)
        if attitude is None and self.profile.needs_attitude:
            self.withheld += 1
            self._fix = self._failed = None
            return None
        if rate:  # a steady beat, which a new position does not disturb
            behind = now - self._next_at
            self._next_at = (now if behind > 1 / rate else self._next_at) + 1 / rate
        self._sent += 1
        if fix is self._failed:
            self._failed = None
            return self.profile.failed(fix, self._stamp(fix.time), attitude)
        # A repetition is the motion model's prediction for a later moment: same place,
        # less certain.
        stamp = fix.time if self._sent == 1 else now
        stamp = max(stamp, self._last_stamp + MIN_STAMP_STEP)
        covariance = self._shared(fix.fusion.covariance) + self._motion_rate * (stamp - fix.time)
        return self.profile.position(fix, self._stamp(stamp), covariance, attitude)

    def _shared(self, covariance: np.ndarray) -> np.ndarray:
        """The covariance of one of several messages made of one image.

        A receiver takes them for independent. The m-th is worth 1 / m (m + 1) of the image, so that
        however many there are, together they never weigh more than it does.
        """
        return covariance * (self._sent * (self._sent + 1) if self.profile.repeat_rate else 1)

    def _stamp(self, stamp: float) -> int:
        self._last_stamp = max(stamp, self._last_stamp + MIN_STAMP_STEP)
        return round(1e6 * self._last_stamp)
