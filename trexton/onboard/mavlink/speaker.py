"""What is to be said to an autopilot, when, and how PX4 and ArduPilot want it. No clock, no wire.

Times are seconds of the steady clock. All of it is called under the sink's lock.
"""

from collections import deque
from typing import Any

import numpy as np

from trexton.onboard.fix import STALE_AFTER, Fix
from trexton.onboard.mavlink.listener import Listener
from trexton.onboard.mavlink.messages import Profile, Report, mavlink

REQUEST_PAUSE = 2.0
ORIGIN_PAUSE, LATER_ORIGIN_PAUSE = 1.0, 10.0
ORIGIN_ATTEMPTS = 10  # after which it is asked less often
REPEAT_AFTER = 0.15  # seconds without an image: EKF2 does without after 0.2, ArduPilot after 0.25
REPEAT_TIMEOUT = STALE_AFTER  # seconds from capture for which a position is repeated
# Seconds by which a repetition's stamp stays behind those of images that arrive with it: one that
# was held up by less than this is still the later of the two, by what EKF2 wants between them.
REPEAT_LAG = 0.09
APART = 0.02  # seconds between stamps, which EKF2 wants at least
REPEAT_INFLATION = 100.0  # of a repetition's covariance: it keeps the fusion alive and is no news
ORIGIN, INTERVAL = mavlink.MAVLINK_MSG_ID_GPS_GLOBAL_ORIGIN, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
INTERVALS = {  # what is asked for where it does not come: message, times a second
    "roll": (mavlink.MAVLINK_MSG_ID_ATTITUDE, 20.0),
    "grounded": (mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, 2.0),
    "height": (mavlink.MAVLINK_MSG_ID_DISTANCE_SENSOR, 20.0),
    "velocity": (mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED, 20.0),
}


class Speaker:
    """What to say to an autopilot, and when.

    Parameters
    ----------
    motion_rate : (2, 2) array
        Covariance that the motion model adds in a second, square metres.
    listener : Listener
        Knows to whom, and what was answered.
    origin : (latitude, longitude, altitude) or None
        Set as the autopilot's global origin until it confirms it, which may take it a while after
        its start. An autopilot that has started anew gets it again.
    aiding : {"tilt", "all", "none"}
        What it is asked for beside its attitude: height, and for all its velocity too.
    send_yaw : bool
        Send our own yaw in place of the autopilot's: where a frame does not show it, none.
    """

    def __init__(
        self,
        profile: Profile,
        motion_rate: np.ndarray,
        listener: Listener,
        origin: tuple[float, float, float] | None = None,
        *,
        aiding: str = "none",
        send_yaw: bool = False,
    ):
        self.profile, self.listener, self._send_yaw = profile, listener, send_yaw
        self._motion_rate, self._origin = motion_rate, origin
        self._boots = listener.boots
        self._intervals = INTERVALS | {"fused": (profile.estimator, 1.0)}
        self._asked = ["roll", "grounded", "fused"]
        self._asked += {"none": [], "tilt": ["height"], "all": ["height", "velocity"]}[aiding]
        self.withheld = 0
        self.commands: deque[Any] = deque()
        self._fix: Fix | None = None  # the latest that an image went into, or that is not usable
        self._told_at = self._said = -np.inf  # when it came; the latest stamp that was sent
        self._shifted = False  # whether the last bears a later stamp than its capture
        self._next_at = -np.inf  # when it is to be sent: at once, then for want of another
        self._due: dict[str, float] = {}
        self._origin_attempts, self._confirmed = 0, False

    def tell(self, fix: Fix, now: float) -> None:
        """Take in a new fix. A prediction is no measurement, and is not passed on."""
        if fix.observed or not fix.usable:
            self._fix = fix if fix.finite else None
            self._told_at, self._next_at = now, -np.inf

    def land(self, confirmation: int, now: float) -> bool:
        """Put a landing command out; False while nobody is there, or it is in doubt who obeys, or
        whether it flies."""
        listener = self.listener
        if listener.target is None or not (listener.present(now) and listener.certain):
            return False
        if not listener.may_fly(now):
            return False
        unset = [self.profile.unset] * 4  # here and now
        self.commands.append(
            mavlink.MAVLink_command_long_message(
                *listener.target, mavlink.MAV_CMD_NAV_LAND, confirmation, 0, 0, 0, *unset
            )
        )
        return True

    def due(self, now: float) -> list[Any]:
        """The messages to send now."""
        out = [*self.commands]
        self.commands.clear()
        out += [
            # Our clock beside the stamp of the request: the autopilot converts our stamps by it.
            mavlink.MAVLink_timesync_message(round(1e9 * now), request.ts1)
            for request in self.listener.timesyncs
        ]
        self.listener.timesyncs.clear()
        if self._is_due("heartbeat", now, 1.0):
            kind, state = mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_STATE_ACTIVE
            nobody = mavlink.MAV_AUTOPILOT_INVALID
            out.append(mavlink.MAVLink_heartbeat_message(kind, nobody, 0, 0, state, 3))
        target = self.listener.target
        if target is not None and self.listener.certain:
            out += self._requests(target, now)
        return out + self._positions(now)

    def _requests(self, target: tuple[int, int], now: float) -> list[Any]:
        out = []
        if self._boots != self.listener.boots:
            self._boots, self._due, self._origin_attempts = self.listener.boots, {}, 0
            self._confirmed = False
        pause = ORIGIN_PAUSE if self._origin_attempts < ORIGIN_ATTEMPTS else LATER_ORIGIN_PAUSE
        origin = self._origin
        # Whoever changes it later has a reason: the log says so, and preflight.
        self._confirmed |= origin is not None and self.listener.confirms(origin)
        if origin is not None and not self._confirmed and self._is_due("origin", now, pause):
            place = [round(1e7 * origin[0]), round(1e7 * origin[1]), round(1000 * origin[2])]
            out.append(
                mavlink.MAVLink_set_gps_global_origin_message(target[0], *place, round(1e6 * now))
            )
            self._origin_attempts += 1
            # ArduPilot passes over what it was given before, and confirms it only if asked.
            command, wanted = mavlink.MAV_CMD_REQUEST_MESSAGE, [ORIGIN, *[0] * 6]
            out.append(mavlink.MAVLink_command_long_message(*target, command, 0, *wanted))
        states = {"grounded": self.listener.landed, "fused": self.listener.fused}
        aiding = self.listener.aiding(now)
        for name in self._asked:
            known = states[name](now) if name in states else getattr(aiding, name)
            if known is None and self._is_due(name, now, REQUEST_PAUSE):
                message, rate = self._intervals[name]
                command, wanted = INTERVAL, [message, 1e6 / rate, *[0] * 5]
                out.append(mavlink.MAVLink_command_long_message(*target, command, 0, *wanted))
        return out

    def _is_due(self, what: str, now: float, pause: float) -> bool:
        if now < self._due.get(what, -np.inf):
            return False
        self._due[what] = now + pause
        return True

    def _positions(self, now: float) -> list[Any]:
        """The messages of the position that is due, if one is.

        Each image goes out once, as of its capture. A repetition is the motion model's prediction
        for a later moment, before which no other image can have been taken; it repeats no yaw.
        """
        fix = self._fix
        if fix is None or now < self._next_at:
            return []
        if fix.usable and fix.age(now) > REPEAT_TIMEOUT:  # old is never taken for fresh
            self._fix = None
            return []
        captured = now - fix.age(now)
        stamp, fusion, again = captured, fix.fusion, bool(np.isfinite(self._next_at))
        covariance = fusion.covariance
        if again:
            stamp += now - self._told_at - REPEAT_LAG
            covariance = REPEAT_INFLATION * (covariance + self._motion_rate * (stamp - captured))
        attitude, failed = self.listener.attitude(stamp), not fix.usable
        self._next_at = now + REPEAT_AFTER
        if failed or (attitude is None and self.profile.needs_attitude):  # said once, or not at all
            self._fix = None
        if attitude is None and self.profile.needs_attitude:
            if not self.withheld:
                self.listener.news.append({"event": "positions withheld for want of attitude"})
            self.withheld += 1
            return []
        yaw = sigma = np.nan
        if self._send_yaw and not failed:
            if fix.heading is not None and fix.heading_sigma is not None and not again:
                yaw, sigma = self.profile.local.yaw(fix.heading), fix.heading_sigma
            elif not self.profile.needs_yaw:
                attitude = None  # its own yaw must not come back to it as ours
            elif again:
                return []
            else:
                failed = True
        held_up, before = stamp <= self._said, self._shifted  # by more than the lag
        self._shifted = held_up and not (again or before)
        if held_up:
            if not (self._shifted or failed):  # else stamps would run ahead
                return []
            stamp = self._said + APART
            covariance = covariance + self._motion_rate * (stamp - captured)
        self._said = stamp
        if failed:
            report = Report(stamp, fix.position, fix.covariance, attitude, fix.resets)
        else:
            report = Report(stamp, fusion.position, covariance, attitude, fix.resets, yaw, sigma)
        said = [self.profile.position(fix, report, failed)]
        said += [] if again or failed else [self.profile.zone(report)]
        return [each for each in said if each is not None]
