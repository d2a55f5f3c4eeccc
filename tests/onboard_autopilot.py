"""A receiver of its own for MAVLink over loopback UDP, and a small autopilot made of it. Needs
pymavlink.
"""

from __future__ import annotations

import socket
import threading
import time
from collections.abc import Callable

from pymavlink.dialects.v20 import ardupilotmega as mavlink

ATTITUDE = (0.1, -0.2, 1.5)
GIMBAL = mavlink.MAVLink_heartbeat_message(26, 8, 0, 0, 4, 3)
GROUND_STATION = mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3)
AUTOPILOT_HEARTBEAT = mavlink.MAVLink_heartbeat_message(2, mavlink.MAV_AUTOPILOT_PX4, 128, 0, 4, 3)
IN_AIR = mavlink.MAVLink_extended_sys_state_message(0, mavlink.MAV_LANDED_STATE_IN_AIR)


def from_autopilot(message, system: int = 1, component: int = 1):
    """The message as if it had come from there."""
    sender = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    return mavlink.MAVLink(None).parse_buffer(message.pack(sender))[0]


def attitude(time: float, angles: tuple[float, float, float] = ATTITUDE):
    """ATTITUDE of an autopilot that has been awake so many seconds."""
    return mavlink.MAVLink_attitude_message(round(1000 * time) % 2**32, *angles, 0, 0, 0)


class Peer:
    """Decodes whatever comes to its port, and can answer the sender."""

    def __init__(self, port: int = 0):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", port))
        self.socket.settimeout(0.05)
        self.port = self.socket.getsockname()[1]
        self.codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
        self.received, self.address, self._stop = [], None, threading.Event()
        self.thread = threading.Thread(target=self._listen, daemon=True)
        self.thread.start()

    def _listen(self) -> None:
        while not self._stop.is_set():
            try:
                data, self.address = self.socket.recvfrom(4096)
            except OSError:
                data = b""
            messages = self.codec.parse_buffer(data) or []
            self.received += messages
            self.react(messages)

    def react(self, messages: list) -> None:
        """What an autopilot would do."""

    def send(self, *parts) -> None:
        for message in parts:
            self.socket.sendto(
                message if isinstance(message, bytes) else message.pack(self.codec), self.address
            )

    def of(self, kind: str) -> list:
        return [message for message in list(self.received) if message.get_type() == kind]

    def close(self) -> None:
        self._stop.set()
        self.thread.join()
        self.socket.close()


class Autopilot(Peer):
    """Beats, tells its attitude, and answers the landing command: "accepts", "denies" or "is
    silent".

    `land` is called once it has accepted. Where it has `company`, a gimbal, a ground station and a
    second vehicle speak on the same wire.
    """

    def __init__(self, manner: str, land: Callable[[], None], company: bool = False):
        self.manner, self._land, self._beat_at = manner, land, 0.0
        self.company, self.alive, self._awake_at = company, True, time.monotonic() - 60
        super().__init__()

    def restart(self) -> None:
        """Alive again, with nothing in its memory."""
        self.received.clear()
        self._awake_at, self.alive = time.monotonic(), True

    def react(self, messages: list) -> None:
        if self.address is not None and time.monotonic() >= self._beat_at:
            self._beat_at = time.monotonic() + 0.2
            if self.company:
                self._others_speak()
            if self.alive:
                awake_ms = int(1000 * (time.monotonic() - self._awake_at))
                attitude = mavlink.MAVLink_attitude_message(awake_ms, *ATTITUDE, 0, 0, 0)
                self.send(AUTOPILOT_HEARTBEAT, IN_AIR, attitude)
        if not self.alive:
            return
        for message in messages:
            if (
                message.get_type() != "COMMAND_LONG"
                or message.command != mavlink.MAV_CMD_NAV_LAND
                or self.manner == "is silent"
            ):
                continue
            self.send(
                mavlink.MAVLink_command_ack_message(
                    message.command, 0 if self.manner == "accepts" else 2
                )
            )
            if self.manner == "accepts":
                self._land()

    def _others_speak(self) -> None:
        crowd = (
            (1, 154, GIMBAL),
            (255, 190, GROUND_STATION),
            (2, 1, AUTOPILOT_HEARTBEAT),
            (2, 1, mavlink.MAVLink_attitude_message(0, 0.5, 0.5, -1.0, 0, 0, 0)),
            (2, 1, mavlink.MAVLink_command_ack_message(mavlink.MAV_CMD_NAV_LAND, 2)),
        )
        for system, component, message in crowd:
            self.send(message.pack(mavlink.MAVLink(None, system, component)))

    @property
    def commands(self) -> list[int]:
        """The confirmation of each landing command."""
        return [
            message.confirmation
            for message in self.of("COMMAND_LONG")
            if message.command == mavlink.MAV_CMD_NAV_LAND
        ]
