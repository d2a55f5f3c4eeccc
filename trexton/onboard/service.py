"""Words to systemd, where it started us: ready, alive, stopping. Its protocol is one datagram."""

from __future__ import annotations

import os
import socket
from collections.abc import Mapping
from contextlib import suppress

__all__ = ["Service"]


class Service:
    """What `sd_notify` says, and nothing where nobody listens; never fails, never waits.

    The loop tells that it is alive from its own thread, so that a loop that hangs is found out and
    the service is started again.

    Parameters
    ----------
    environment : mapping
        With ``NOTIFY_SOCKET`` and ``WATCHDOG_USEC`` where systemd set them.
    """

    def __init__(self, environment: Mapping[str, str] = os.environ):
        self._address = environment.get("NOTIFY_SOCKET", "")
        interval = environment.get("WATCHDOG_USEC", "")
        self._pause = 1e-6 * int(interval) / 3 if interval.isdecimal() else float("inf")
        self._next = float("-inf")

    def ready(self) -> None:
        """The loop runs."""
        self._say("READY=1")

    def alive(self, now: float) -> None:
        """The loop has come round again; told three times in the watchdog's interval at most."""
        if self._pause < float("inf") and now >= self._next:
            self._next = now + self._pause
            self._say("WATCHDOG=1")

    def status(self, line: str) -> None:
        """What ``systemctl status`` shows."""
        self._say(f"STATUS={line}")

    def stopping(self) -> None:
        """The end was asked for."""
        self._say("STOPPING=1")

    def _say(self, words: str) -> None:
        if not self._address:
            return
        place = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as wire:
            wire.setblocking(False)
            wire.sendto(words.encode(), place)
