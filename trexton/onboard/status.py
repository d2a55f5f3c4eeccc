"""How the run stands: the status line once a second, the summary at the end, and what systemd is
told where it started us."""

from __future__ import annotations

import os
import resource
import socket
import sys
from collections import deque
from collections.abc import Mapping, Sequence
from contextlib import suppress
from typing import Any

import numpy as np

from trexton.onboard.commander import Commander
from trexton.onboard.fix import Fix
from trexton.onboard.sinks.base import Guard
from trexton.onboard.tally import Tally

__all__ = ["Service", "Status"]

LATENCIES = 65536  # that are kept, the latest ones


class Status:
    """What a pilot wants to know at a glance.

    Parameters
    ----------
    tally : Tally
    sinks : list of Guard
    commander : Commander or None
    warnings : sequence of str
        Said in every line.
    """

    def __init__(
        self, tally: Tally, sinks: list[Guard], commander: Commander | None = None,
        warnings: Sequence[str] = (),
    ):  # fmt: skip
        self._tally, self._sinks = tally, sinks
        self.commander, self.warnings = commander, warnings
        self._latencies: deque[float] = deque(maxlen=LATENCIES)
        self._longest = 0.0
        self._frames = 0
        self._last_at: float | None = None

    def took(self, seconds: float) -> None:
        """Take in the latency of a frame."""
        self._latencies.append(seconds)
        self._longest = max(self._longest, seconds)

    def _latency(self, share: float) -> float:
        """What this share of the latencies does not exceed; NaN before the first."""
        return float(np.quantile(self._latencies, share)) if self._latencies else float("nan")

    def due(self, now: float) -> bool:
        """Whether a second has passed since the last line."""
        return self._last_at is None or now - self._last_at >= 1.0

    def line(self, fix: Fix | None, now: float) -> str:
        """The status now."""
        frames = self._tally["frames"]
        rate = (frames - self._frames) / (now - self._last_at) if self._last_at is not None else 0.0
        self._last_at, self._frames = now, frames
        parts = [
            f"{frames} frames {rate:.1f}/s, dropped {self._tally['dropped']}",
            self._where(fix),
        ]
        if frames:
            median, slowest = (1e3 * self._latency(share) for share in (0.5, 0.99))
            parts.append(f"latency {median:.1f} ms, p99 {slowest:.1f} ms")
        parts += [
            f"{guard.sink.name}: {words}" for guard in self._sinks if (words := guard.sink.status())
        ]
        if self.commander is not None:
            why = f" ({self.commander.why})" if self.commander.why else ""
            parts.append(f"landing: {self.commander.state.value}{why}")
        if self.warnings:
            parts.append("WARNING: " + "; ".join(self.warnings))
        if faults := self._tally.faults:
            parts.append(
                "faults: " + ", ".join(f"{name} {count}" for name, count in faults.items())
            )
        return " | ".join(parts)

    @staticmethod
    def _where(fix: Fix | None) -> str:
        if fix is None:
            return "no frame yet"
        flags = " LOST" * fix.lost + " STALE" * fix.stale
        x, y = fix.position
        return f"x {x:.2f} y {y:.2f} m, spread {fix.spread[0]:.2f} {fix.spread[1]:.2f} m{flags}"

    def summary(self) -> dict[str, Any]:
        """Counts, latencies in seconds and the most memory in bytes over the whole run."""
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        return {
            "frames": self._tally["frames"],
            "observed": self._tally["observed"],
            "dropped": self._tally["dropped"],
            "latency_s": {
                "median": self._latency(0.5),
                "p99": self._latency(0.99),
                "longest": self._longest,
            },
            "memory_bytes": most * (1 if sys.platform == "darwin" else 1024),
            "faults": self._tally.faults,
        }


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

    def say(self, words: str) -> None:
        """As ``READY=1``, ``STOPPING=1``, or ``STATUS=`` for what ``systemctl status`` shows."""
        if not self._address:
            return
        place = "\0" + self._address[1:] if self._address.startswith("@") else self._address
        with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as wire:
            wire.setblocking(False)
            wire.sendto(words.encode(), place)

    def alive(self, now: float) -> None:
        """The loop has come round again; told three times in the watchdog's interval at most."""
        if self._pause < float("inf") and now >= self._next:
            self._next = now + self._pause
            self.say("WATCHDOG=1")
