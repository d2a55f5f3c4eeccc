"""What became of a step, and one progress display: a bar on a terminal, a line a step elsewhere."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Mapping
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
    """Counts finished steps of `total` and names those that are running; nothing when quiet.

    Where it is known about how many seconds each step takes (`costs`, by name), it says how long
    all of them will, `jobs` at once, and after each how much is left.
    """

    def __init__(
        self,
        total: int,
        of: str = "notebooks",
        costs: Mapping[str, float] | None = None,
        jobs: int = 1,
    ):
        self._running: dict[str, str] = {}
        self._costs, self._jobs, self._begun = dict(costs or {}), jobs, time.monotonic()
        self._worked = 0.0  # seconds that those were thought to take which ran
        self._lock = threading.Lock()
        self._bar: Any = None
        if total and not is_quiet() and sys.stderr.isatty():
            from tqdm import tqdm

            self._bar = tqdm(total=total, desc=of, file=sys.stderr, leave=False, dynamic_ncols=True)

    def __enter__(self) -> Display:
        if self._costs:
            say(f"{len(self._costs)} notebooks: {self.left()} if none of them can be reused")
        return self

    def left(self) -> str:
        """About how long the unfinished steps will take, by how long the others took."""
        elapsed = time.monotonic() - self._begun
        pace = elapsed * self._jobs / self._worked if self._worked else 1.0
        minutes = pace * sum(self._costs.values()) / self._jobs / 60
        return f"about {minutes:.0f} minutes" if minutes >= 1 else "less than a minute"

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
        name = f"{outcome.flight}/{outcome.experiment}".strip("/")
        with self._lock:
            self._running.pop(name, None)
            cost = self._costs.pop(name, 0.0)
            self._worked += cost if outcome.status == "ran" else 0.0
            if self._bar is None:
                if outcome.status != "reused":
                    say(f"{outcome}, {self.left()} left" if self._costs else str(outcome))
                return
            if outcome.status != "reused":
                self._bar.write(str(outcome), file=sys.stderr)
            self._bar.update(1)
            self._bar.set_postfix_str(", ".join(self._running.values()))
