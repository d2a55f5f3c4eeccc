"""What is heard on the wire, and which of it counts: an autopilot among others who also speak.

Times are seconds of the steady clock.
"""

from bisect import bisect_left
from collections import deque
from operator import itemgetter
from typing import Any, TypeVar

import numpy as np

from trexton.flights.aiding import Aiding
from trexton.onboard.fix import LocalFrame
from trexton.onboard.mavlink.messages import mavlink
from trexton.onboard.settings import COMPONENT

HEARTBEAT_TIMEOUT = 3.0  # seconds without a heartbeat after which the autopilot counts as gone
MAX_STATE_AGE = 5.0  # seconds for which "has a position" and "on the ground" are believed
CLOCK_STEP_S = 2.0  # seconds by which a clock must begin later to be another
SAME_CLOCK_S = 0.5  # seconds to which messages tell when their clock began
CONFIRMED_S = 1.0  # seconds for which nobody goes on with the clock of before a restart
MOST_SWAPS = 5  # from one clock to the other within `MAX_STATE_AGE`: two autopilots
ALONE_S = 60.0  # seconds: an autopilot starts up no later than the computer beside it
WRAP_MS = 60_000  # milliseconds about the last of a clock of 32 bits in which it may wrap
BUFFER_SIZE = 512  # of each: a second and more of the fastest stream, for a camera that is late
MAX_SAMPLE_AGE = 0.5  # seconds between a frame and attitude, height or velocity that fit it
NO_AUTOPILOTS = (mavlink.MAV_AUTOPILOT_GENERIC, mavlink.MAV_AUTOPILOT_INVALID)
# MAV_TYPE of what flies, drives or swims, by number: names have changed between dialects.
VEHICLES = {*range(1, 5), *range(7, 18), *range(19, 26), 28, 29, 35}
STANDS = mavlink.MAV_LANDED_STATE_ON_GROUND
DOWNWARD = mavlink.MAV_SENSOR_ROTATION_PITCH_270
INVALID_SIGNAL = 1  # of 100; 0 is unknown
MAX_ANGLES = np.array([3.2, 1.6, 3.2])  # radians of roll, pitch and yaw
T = TypeVar("T")


class Listener:
    """Listens to one autopilot, whoever else is on the wire.

    Only an autopilot's heartbeat can make somebody the target: it names an autopilot, and it comes
    from component 1 or a type of vehicle, unless a component was named. The first vehicle that is
    heard is ours.

    `named` are system and component of our autopilot, None for the only one that is heard. Answers
    to another `component` than ours are none to us. Every autopilot that may be ours, of all links
    of a flight, is put into `heard`, with when it was heard first.

    `twins` tells whether two autopilots of its number were heard, `signs` whether it signs its
    messages, and `boots` how often it has started anew.
    """

    def __init__(
        self,
        named: tuple[int | None, int | None] = (None, None),
        local: LocalFrame | None = None,
        component: int = COMPONENT,
        heard: dict[tuple[int, int], float] | None = None,
    ):
        self._named, self._local, self._component = named, local or LocalFrame(), component
        self.target: tuple[int, int] | None = None
        self.heard = {} if heard is None else heard
        self.heard_at = -np.inf
        self.boots = self._awake_ms = 0
        self.twins = self.signs = False
        self.answers: deque[int] = deque(maxlen=64)  # to landing commands
        self.news: deque[dict[str, Any]] = deque(maxlen=256)
        self.timesyncs: deque[Any] = deque(maxlen=16)
        self.origin: tuple[float, float] | None = None
        self._fused: tuple[float, bool] | None = None
        self._landed: tuple[float, int] | None = None
        self._mode: int | None = None
        self._armed, self._since = True, np.inf  # as it says; heard so without a gap since then
        self._clock = self._stamped_at = -np.inf  # when its clock began; its last message
        self._stray: tuple[float, float] | None = None  # another clock, and first heard
        self._swaps: deque[float] = deque(maxlen=MOST_SWAPS)
        self._odd_angles = False
        self._attitudes: deque[tuple[float, tuple[float, float, float]]] = deque(maxlen=BUFFER_SIZE)
        self._heights: deque[tuple[float, float]] = deque(maxlen=BUFFER_SIZE)
        self._velocities: deque[tuple[float, tuple[float, float]]] = deque(maxlen=BUFFER_SIZE)

    def hear(self, message: Any, now: float) -> None:
        """Take in one message, where there is a method for its kind: ``_on_`` and its name."""
        kind = message.get_type()
        handler = getattr(self, f"_on_{kind.lower()}", None)
        if handler is None:
            return
        if self.target == (message.get_srcSystem(), message.get_srcComponent()):
            if self._is_in_order(getattr(message, "time_boot_ms", None), now):
                handler(message, now)
        elif kind == "HEARTBEAT":
            handler(message, now)

    def present(self, now: float) -> bool:
        """Whether the autopilot has been heard lately."""
        return self.target is not None and now - self.heard_at <= HEARTBEAT_TIMEOUT

    @property
    def certain(self) -> bool:
        """Whether the target is beyond doubt: named, or the only autopilot that was ever heard."""
        return len(self.heard) == 1 and not self.twins

    @property
    def doubted(self) -> bool:
        """Whether the target never was alone for long: another came soon after, or is its twin."""
        first, second, *_ = (*self.heard.values(), np.inf, np.inf)
        return self.twins or second - first < ALONE_S

    def fused(self, now: float) -> bool | None:
        """Whether the autopilot has a horizontal position; None where it has not said so lately."""
        return _recent(self._fused, now)

    def landed(self, now: float) -> int | None:
        """The landed state; None where the autopilot has not said so lately."""
        return _recent(self._landed, now)

    def on_ground(self, now: float) -> bool | None:
        """Whether the vehicle stands, or is not armed; None where that is not known."""
        if self.present(now) and not self._armed:
            return True
        landed = self.landed(now)
        return None if landed is None else landed == STANDS

    def may_fly(self, now: float) -> bool:
        """Whether it flies as far as is known: who was heard for less than `MAX_STATE_AGE` has not
        had the time to say that it stands, and who said so last may stand yet."""
        if (grounded := self.on_ground(now)) is not None:
            return not grounded
        stood = self._landed is not None and self._landed[1] == STANDS
        return now - self._since > MAX_STATE_AGE and not stood

    def phase(self, now: float) -> dict[str, object]:
        """What tells a landing from any other flight, as far as it was said lately."""
        landed = self.landed(now)
        known = {"mode": self._mode if self.present(now) else None,
                 "landing": landed and landed == mavlink.MAV_LANDED_STATE_LANDING,
                 "grounded": self.on_ground(now)}  # fmt: skip
        return {name: value for name, value in known.items() if value is not None}

    def confirms(self, origin: tuple[float, float, float]) -> bool:
        """Whether the autopilot's origin is this one, to within a metre or so."""
        ours = self.origin
        return ours is not None and bool(np.allclose(ours, origin[:2], rtol=0, atol=1e-5))

    def attitude(self, time: float) -> tuple[float, float, float] | None:
        """The autopilot's own roll, pitch, yaw nearest to that moment, if near enough; of nobody
        who was never ours beyond doubt."""
        entry = None if self.doubted else _nearest(self._attitudes, time)
        return None if entry is None else entry[1]

    def aiding(self, time: float) -> Aiding:
        """What the autopilot knows of that moment, in the map's axes; see `attitude`."""
        if self.doubted:
            return Aiding()
        attitude = _nearest(self._attitudes, time)
        height, velocity = _nearest(self._heights, time), _nearest(self._velocities, time)
        # What share of a distance along the vehicle's own axis is height.
        tilt = None if height is None else self.attitude(height[0])
        upright = 1.0 if tilt is None else float(np.cos(tilt[0]) * np.cos(tilt[1]))
        roll, pitch, yaw = (None, None, None) if attitude is None else attitude[1]
        if yaw is not None:
            ahead = self._local.ned_from_map @ (np.cos(yaw), np.sin(yaw))  # its own inverse
            yaw = float(np.arctan2(-ahead[0], ahead[1]))  # from the map's y, anticlockwise
        return Aiding(
            roll, pitch, yaw,
            None if height is None else height[1] * upright,
            None if velocity is None else self._local.ned_from_map @ velocity[1],
            *(None if entry is None else entry[0] for entry in (attitude, height, velocity)),
        )  # fmt: skip

    def _on_heartbeat(self, message: Any, now: float) -> None:
        who = system, component = message.get_srcSystem(), message.get_srcComponent()
        vehicle = component == mavlink.MAV_COMP_ID_AUTOPILOT1 or message.type in VEHICLES
        if self._named[1] is None and (message.autopilot in NO_AUTOPILOTS or not vehicle):
            return
        if any(own not in (None, number) for own, number in zip(self._named, who, strict=True)):
            return
        if who not in self.heard:
            self.heard[who] = now
            if len(self.heard) > 1:
                heard = ", ".join(f"{each}/{part}" for each, part in sorted(self.heard))
                advice = "name ours with --target; no landing until then"
                advice += ", and no attitude" * self.doubted
                self.news.append({"event": "several vehicles", "heard": heard, "do": advice})
        if self.target is None and who == next(iter(self.heard)):
            self.target = who
            self.news.append({"event": "autopilot", "system": system, "component": component})
        if self.target == who:
            armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            if not self.present(now) or armed and not self._armed:
                self._since = now
            self.heard_at, self._mode, self._armed = now, message.custom_mode, armed
            self.signs = bool(message.get_header().incompat_flags & mavlink.MAVLINK_IFLAG_SIGNED)

    def _is_in_order(self, awake_ms: int | None, now: float) -> bool:
        """False of a message that comes seconds late, as a link that had stalled gives many.

        Its clock seems to begin later. So does that of an autopilot that has started anew, but
        nobody goes on with the earlier one; where somebody does again and again, there are two.
        """
        if not awake_ms:  # 0 is of a message that tells no time
            return True
        began, wrapped = now - 1e-3 * awake_ms, (awake_ms - self._awake_ms) % 2**32 < WRAP_MS
        back = self._awake_ms > awake_ms and not wrapped
        silent = now - self._stamped_at > HEARTBEAT_TIMEOUT
        behind = back or silent and began > self._stamped_at - SAME_CLOCK_S  # begun meanwhile
        if behind and np.isfinite(self._clock) and began - self._clock > CLOCK_STEP_S:
            if self._stray is None or began < self._stray[0] - SAME_CLOCK_S:  # a backlog's
                self._stray = began, now
            if now - self._stray[1] < CONFIRMED_S:
                return False
            self._start_anew(now)
        elif self._stray is not None:
            self._swaps.append(now)
            often = len(self._swaps) == MOST_SWAPS and now - self._swaps[0] < MAX_STATE_AGE
            if often and not self.twins:
                self.twins = True
                self._start_anew(now)
        self._clock, self._awake_ms, self._stamped_at, self._stray = began, awake_ms, now, None
        return True

    def _start_anew(self, now: float) -> None:
        self.boots, self._since = self.boots + 1, now
        self._fused = self._landed = self.origin = None
        for samples in (self._attitudes, self._heights, self._velocities):
            samples.clear()
        words = "two autopilots of one number" if self.twins else "autopilot restarted"
        self.news.append({"event": words, "times": self.boots})

    def _on_attitude(self, message: Any, now: float) -> None:
        angles = (message.roll, message.pitch, message.yaw)
        if (np.abs(angles) <= MAX_ANGLES).all():
            self._attitudes.append((now, angles))
        elif not self._odd_angles and np.isfinite(angles).all():
            self._odd_angles = True
            self.news.append({"event": "attitude is none in radians: not used", "angles": angles})

    def _on_distance_sensor(self, message: Any, now: float) -> None:
        distance = message.current_distance  # centimetres
        if (
            message.orientation == DOWNWARD
            and message.signal_quality != INVALID_SIGNAL
            and message.min_distance <= distance <= message.max_distance
        ):
            self._heights.append((now, 0.01 * distance))

    def _on_local_position_ned(self, message: Any, now: float) -> None:
        if np.isfinite((message.vx, message.vy)).all():
            self._velocities.append((now, (message.vx, message.vy)))

    def _on_timesync(self, message: Any, now: float) -> None:
        if message.tc1 == 0:  # a request; anything else answers somebody's
            self.timesyncs.append(message)

    def _on_command_ack(self, message: Any, now: float) -> None:
        # Target 0 is everybody, or an autopilot of before targets were in the message.
        ours = (0, message.get_srcSystem())
        if message.target_system in ours and message.target_component in (0, self._component):
            if message.command == mavlink.MAV_CMD_NAV_LAND:
                self.answers.append(message.result)
            answer = {"command": message.command, "result": message.result}
            self.news.append({"event": "answer", **answer})

    def _on_gps_global_origin(self, message: Any, now: float) -> None:
        latitude, longitude = message.latitude * 1e-7, message.longitude * 1e-7
        self.origin = latitude, longitude
        self.news.append({"event": "origin", "latitude": latitude, "longitude": longitude})

    def _on_statustext(self, message: Any, now: float) -> None:
        text = message.text if isinstance(message.text, str) else repr(message.text)
        self.news.append({"event": "autopilot says", "severity": message.severity, "text": text})

    def _on_estimator_status(self, message: Any, now: float) -> None:
        horizontal = mavlink.ESTIMATOR_POS_HORIZ_REL | mavlink.ESTIMATOR_POS_HORIZ_ABS
        self._fused = (now, bool(message.flags & horizontal))

    _on_ekf_status_report = _on_estimator_status  # ArduPilot's, with the same flags

    def _on_extended_sys_state(self, message: Any, now: float) -> None:
        if message.landed_state != mavlink.MAV_LANDED_STATE_UNDEFINED:
            self._landed = (now, message.landed_state)


def _recent(said: tuple[float, T] | None, now: float) -> T | None:
    return said[1] if said is not None and now - said[0] <= MAX_STATE_AGE else None


def _nearest(entries: deque[tuple[float, Any]], time: float) -> tuple[float, Any] | None:
    after = bisect_left(entries, time, key=itemgetter(0))
    around = [entries[index] for index in (after - 1, after) if 0 <= index < len(entries)]
    nearest = min(around, key=lambda entry: abs(entry[0] - time), default=None)
    return nearest if nearest is not None and abs(nearest[0] - time) <= MAX_SAMPLE_AGE else None
