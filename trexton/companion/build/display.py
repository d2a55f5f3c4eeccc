"""What became of a step, and one progress display: a bar on a terminal, a line a step elsewhere."""

from __future__ import annotations

import sys
import threading
from dataclasses import dataclass
from typing import Any

from trexton.base.progress import is_quiet, say

__all__ = ["Display", "Outcome"]


@dataclass(frozen=True)
class Outcome:
    """An experiment on a flight ``ran``, was ``reused``, ``skipped`` or ``failed``, and why."""

    flight: str
    experiment: str
    status: str
    reasons: tuple[str, ...] = ()
    seconds: float = 0.0

    @property
    def good(self) -> bool:
        """Whether its results are there."""
        return self.status in ("ran", "reused")

    def __str__(self) -> str:
        where = f"{self.flight}/{self.experiment}" if self.flight else self.experiment
        took = f" ({self.seconds:.1f} s)" if self.status in ("ran", "failed") else ""
        return f"{self.status:<8}{where}{took}"


class Display:
    """Counts finished steps of `total` and names those that are running; nothing when quiet."""

    def __init__(self, total: int, of: str = "notebooks"):
        self._running: dict[str, str] = {}
        self._lock = threading.Lock()
        self._bar: Any = None
        if total and not is_quiet() and sys.stderr.isatty():
            from tqdm import tqdm

            self._bar = tqdm(total=total, desc=of, file=sys.stderr, leave=False, dynamic_ncols=True)

    def __enter__(self) -> Display:
        return self

    def __exit__(self, *_: object) -> None:
        if self._bar is not None:
            self._bar.close()

    def moved(self, name: str, done: int, total: int) -> None:
        """How far the step is."""
        with self._lock:
            self._running[name] = f"{name} {done}/{total}"
            if self._bar is not None:
                self._bar.set_postfix_str(", ".join(self._running.values()))

    def finished(self, outcome: Outcome) -> None:
        """Tell of one step."""
        with self._lock:
            self._running.pop(f"{outcome.flight}/{outcome.experiment}".strip("/"), None)
            if self._bar is None:
                if outcome.status != "reused":
                    say(str(outcome))
                return
            if outcome.status != "reused":
                self._bar.write(str(outcome), file=sys.stderr)
            self._bar.update(1)
            self._bar.set_postfix_str(", ".join(self._running.values()))
