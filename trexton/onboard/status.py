"""How the run stands. There is a status line once a second, and the summary at the end."""

import resource
import sys
from collections import deque
from collections.abc import Sequence
from itertools import islice
from typing import Any

import numpy as np

from trexton.onboard.commander import Commander
from trexton.onboard.fix import Fix
from trexton.onboard.sinks import Guard
from trexton.onboard.tally import Tally

LATENCIES, SHOWN = 65536, 4096  # that are kept for the summary, and for a line: the latest


class Status:
    """What a pilot wants to know at a glance; warnings are said in every line."""

    def __init__(
        self, tally: Tally, sinks: list[Guard], commander: Commander | None, warnings: Sequence[str]
    ):
        self._tally, self._sinks = tally, sinks
        self.commander, self.warnings = commander, warnings
        self.latencies: deque[float] = deque(maxlen=LATENCIES)  # seconds, one a frame
        self._frames = 0
        self._last_at: float | None = None

    def _latency(self, *shares: float, latest: int = LATENCIES) -> list[float]:
        """What these shares of the latencies do not exceed; NaN before the first."""
        return np.quantile([*islice(reversed(self.latencies), latest)] or [np.nan], shares).tolist()

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
            median, slowest = self._latency(0.5, 0.99, latest=SHOWN)
            parts.append(f"latency {1e3 * median:.1f} ms, p99 {1e3 * slowest:.1f} ms")
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
        """Counts, latencies in seconds, most memory in bytes; how a landing stood at the end."""
        most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        landing = {} if self.commander is None else {"landing": self.commander.state.value}
        return landing | {
            "frames": self._tally["frames"],
            "observed": self._tally["observed"],
            "dropped": self._tally["dropped"],
            "withheld": self._tally["withheld"],
            "latency_s": dict(
                zip(("median", "p99", "longest"), self._latency(0.5, 0.99, 1.0), strict=True)
            ),
            "memory_bytes": most * (1 if sys.platform == "darwin" else 1024),
            "faults": self._tally.faults,
        }
