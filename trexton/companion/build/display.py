"""What became of a step, a line for each. The time that is left is estimated."""

import time
from collections.abc import Mapping
from dataclasses import dataclass

from trexton.base.progress import say


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
    """A line for each finished step that was not reused; nothing when quiet.

    Where it is known about how many seconds each step takes (`costs`, by name), it says how long
    all of them will, `jobs` at once, and after each how much is left.
    """

    def __init__(self, costs: Mapping[str, float] | None = None, jobs: int = 1):
        self._costs, self._jobs, self._begun = dict(costs or {}), jobs, time.monotonic()
        self._worked = 0.0  # seconds that those were thought to take which ran
        if self._costs:
            say(f"{len(self._costs)} notebooks: {self.left()} if none of them can be reused")

    def left(self) -> str:
        """About how long the unfinished steps will take, by how long the others took."""
        elapsed = time.monotonic() - self._begun
        pace = elapsed * self._jobs / self._worked if self._worked else 1.0
        minutes = pace * sum(self._costs.values()) / self._jobs / 60
        return f"about {minutes:.0f} minutes" if minutes >= 1 else "less than a minute"

    def finished(self, outcome: Outcome) -> None:
        """Tell of one step."""
        cost = self._costs.pop(f"{outcome.flight}/{outcome.experiment}".strip("/"), 0.0)
        self._worked += cost if outcome.status == "ran" else 0.0
        if outcome.status != "reused":
            say(f"{outcome}, {self.left()} left" if self._costs else str(outcome))
