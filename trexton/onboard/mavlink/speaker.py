"""The conversation with an autopilot: what is due to be said now, and what was heard. No clock, no wire.

Times are seconds of the clock that stamps fixes. All of it is called under the sink's lock.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

import numpy as np

from trexton.onboard.fix import Fix
from trexton.onboard.mavlink import messages
from trexton.onboard.mavlink.messages import mavlink
from trexton.onboard.mavlink.profiles import Profile

__all__ = ["Answer", "Speaker"]

SILENCE = 3.0  # seconds without a heartbeat after which the autopilot counts as gone
REQUEST_PAUSE = 2.0
ORIGIN_ATTEMPTS = 10
PATIENCE = 0.5  # seconds for which a position is repeated while the loop says nothing at all
ATTITUDE_RATE = 20.0
ATTITUDE_AGE = 0.5  # an attitude farther from the frame in time says nothing about it
SHORTEST_STEP = 1e-3  # stamps of successive messages differ by at least this


@dataclass(frozen=True)
class Answer:
    """A COMMAND_ACK: the command, and what became of it."""

    command: int
    result: int


class Speaker:
    """What to say to an autopilot, and when.

    Parameters
    ----------
    profile : Profile
    motion_rate : (2, 2) array
        Covariance that the motion model adds in a second, square metres.
    origin : (latitude, longitude, altitude) or None
        Set as the autopilot's global origin, again and again until it confirms it, but not for ever.
    """

    def __init__(
        self,
        profile: Profile,
        motion_rate: np.ndarray,
        origin: tuple[float, float, float] | None = None,
    ):
        self.profile, self._motion_rate, self._origin = profile, motion_rate, origin
        self.target: tuple[int, int] | None = None
        self.heard_at = -np.inf
        self.withheld = 0
        self.fused: bool | None = None
        self.answers: deque[Answer] = deque(maxlen=16)
        self.news: deque[dict] = deque(maxlen=256)
        self._attitudes: deque[tuple[float, tuple]] = deque(maxlen=64)
        self._outbox: deque = deque(maxlen=16)
        self._fix: Fix | None = None  # the latest usable one that an image went into
        self._told_at = 0.0
        self._sent = 0  # times it has been sent
        self._failed: Fix | None = None
        self._last_stamp = -np.inf
        self._due: dict[str, float] = {}
        self._origin_attempts = 0

    # Said by us

    def tell(self, fix: Fix, now: float) -> None:
        """Take in a new fix. A prediction is no measurement: only what an image went into is passed on."""
        if not fix.usable:
            self._fix, self._failed = None, fix if fix.finite else None
        elif fix.observed:
            self._fix, self._failed = fix, None
        else:
            return
        self._told_at, self._sent = now, 0

    def land(self, confirmation: int) -> bool:
        """Put a landing command out; False while no autopilot is there to obey it."""
        if self.target is None:
            return False
        self._outbox.append(messages.land(self.target, confirmation, self.profile.unset))
        return True

    def due(self, now: float) -> list:
        """The messages to send now."""
        out = list(self._outbox)
        self._outbox.clear()
        if self._is_due("heartbeat", now, 1.0):
            out.append(messages.heartbeat())
        if self.target is not None:
            if self._origin is not None and self._is_due("origin", now, REQUEST_PAUSE):
                out.append(self._ask_for_origin(now))
            if self._attitude_at(now) is None and self._is_due("attitude", now, REQUEST_PAUSE):
                out.append(messages.attitude_request(self.target, ATTITUDE_RATE))
        position = self._position(now)
        return out if position is None else [*out, position]

    def _ask_for_origin(self, now: float):
        message = messages.origin(self.target[0], *self._origin, round(1e6 * now))
        self._origin_attempts += 1
        if self._origin_attempts == ORIGIN_ATTEMPTS:
            self._origin = None
            self.news.append({"event": "origin not confirmed", "attempts": ORIGIN_ATTEMPTS})
        return message

    def next_due(self, now: float) -> float:
        """Seconds until something may be due again."""
        wait = self._due.get("heartbeat", now) - now
        if self._fix is not None and self.profile.repeat_rate:
            wait = min(wait, self._repeat_at() - now)
        return max(0.0, wait)

    def _is_due(self, what: str, now: float, pause: float) -> bool:
        if now < self._due.get(what, -np.inf):
            return False
        self._due[what] = now + pause
        return True

    def _repeat_at(self) -> float:
        return self._told_at + self._sent / self.profile.repeat_rate

    def _position(self, now: float):
        """The position message that is due, if one is."""
        if self._fix is not None and now - self._told_at > PATIENCE:
            self._fix = None
        fix, first = self._fix or self._failed, not self._sent
        if fix is None or not (first or (self.profile.repeat_rate and now >= self._repeat_at())):
            return None
        attitude = self._attitude_at(fix.time)
        if attitude is None and self.profile.needs_attitude:
            self.withheld += 1
            self._fix = self._failed = None
            return None
        self._sent += 1
        if fix is self._failed:
            self._failed = None
            return self.profile.failed(fix, self._stamp(fix.time), attitude)
        # A repetition is the motion model's prediction for a later moment: same place, more uncertainty.
        since = 0.0 if first else max(0.0, now - self._told_at)
        stamp = max(fix.time + since, self._last_stamp + SHORTEST_STEP)
        covariance = self._shared(fix.covariance) + self._motion_rate * (stamp - fix.time)
        return self.profile.position(fix, self._stamp(stamp), covariance, attitude)

    def _shared(self, covariance: np.ndarray) -> np.ndarray:
        """The covariance of one of several messages made of one image.

        A receiver takes them for independent. The m-th is worth 1 / m (m + 1) of the image, so that however
        many there are, together they never weigh more than it does.
        """
        return covariance * (self._sent * (self._sent + 1) if self.profile.repeat_rate else 1)

    def _stamp(self, stamp: float) -> int:
        self._last_stamp = max(stamp, self._last_stamp + SHORTEST_STEP)
        return round(1e6 * self._last_stamp)

    def _attitude_at(self, time: float) -> tuple | None:
        """The autopilot's own roll, pitch, yaw nearest to that moment, if near enough."""
        nearest = min(self._attitudes, key=lambda entry: abs(entry[0] - time), default=None)
        return (
            nearest[1] if nearest is not None and abs(nearest[0] - time) <= ATTITUDE_AGE else None
        )

    # Heard by us

    def hear(self, message, now: float) -> None:
        """Take in one message."""
        handler = getattr(self, f"_on_{message.get_type().lower()}", None)
        if handler is not None:
            handler(message, now)

    def present(self, now: float) -> bool:
        """Whether the autopilot has been heard lately."""
        return now - self.heard_at <= SILENCE

    def _on_heartbeat(self, message, now: float) -> None:
        if (
            message.autopilot == mavlink.MAV_AUTOPILOT_INVALID
            or message.type == mavlink.MAV_TYPE_GCS
        ):
            return
        self.heard_at = now
        if self.target is None:
            self.target = (message.get_srcSystem(), message.get_srcComponent())
            self.news.append(
                {"event": "autopilot", "system": self.target[0], "component": self.target[1]}
            )

    def _from_autopilot(self, message) -> bool:
        return self.target == (message.get_srcSystem(), message.get_srcComponent())

    def _on_attitude(self, message, now: float) -> None:
        angles = (message.roll, message.pitch, message.yaw)
        if self._from_autopilot(message) and np.isfinite(angles).all():
            self._attitudes.append((now, angles))

    def _on_timesync(self, message, now: float) -> None:
        if message.tc1 == 0:  # a request; anything else answers somebody's
            self._outbox.append(messages.timesync_reply(message, round(1e9 * now)))

    def _on_command_ack(self, message, now: float) -> None:
        if self._from_autopilot(message) and message.target_component in (0, messages.COMPONENT):
            self.answers.append(Answer(message.command, message.result))
            self.news.append(
                {"event": "answer", "command": message.command, "result": message.result}
            )

    def _on_gps_global_origin(self, message, now: float) -> None:
        """The autopilot tells its origin: ours is set where it is the same to within a metre or so."""
        if self._origin is None or not self._from_autopilot(message):
            return
        told = (message.latitude * 1e-7, message.longitude * 1e-7)
        self.news.append({"event": "origin", "latitude": told[0], "longitude": told[1]})
        if np.allclose(told, self._origin[:2], rtol=0, atol=1e-5):
            self._origin = None

    def _on_statustext(self, message, now: float) -> None:
        if self._from_autopilot(message):
            self.news.append(
                {"event": "autopilot says", "severity": message.severity, "text": message.text}
            )

    def _on_estimator_status(self, message, now: float) -> None:
        if self._from_autopilot(message):
            horizontal = mavlink.ESTIMATOR_POS_HORIZ_REL | mavlink.ESTIMATOR_POS_HORIZ_ABS
            self.fused = bool(message.flags & horizontal)

    def _on_ekf_status_report(self, message, now: float) -> None:
        if self._from_autopilot(message):
            self.fused = bool(
                message.flags & (mavlink.EKF_POS_HORIZ_REL | mavlink.EKF_POS_HORIZ_ABS)
            )
