"""The landing: the paper's trigger (Sec. Triggered Landing), and what keeps it safe."""

from __future__ import annotations

from collections.abc import Callable
from enum import Enum
from typing import Protocol

from trexton.landing import LandingZone
from trexton.localizer import Estimate
from trexton.onboard.fix import Fix

__all__ = ["Commander", "Lander", "State"]

NAV_LAND = 21
ACCEPTED, TEMPORARILY_REJECTED, IN_PROGRESS, CANCELLED = 0, 1, 5, 6
REASONS = {1: "temporarily rejected", 2: "denied", 3: "unsupported", 4: "failed", 6: "cancelled"}


class Lander(Protocol):
    """Something that can be told to land, and answers: the MAVLink sink."""

    def land(self, confirmation: int) -> bool: ...

    def answers(self) -> list: ...


class State(Enum):
    """Where the landing stands."""

    WATCHING = "watching"
    WOULD_LAND = "WOULD LAND (dry run)"
    ASKED = "asked to land, no answer yet"
    LANDING = "LANDING"
    REFUSED = "REFUSED"
    UNANSWERED = "NO ANSWER"


class Commander:
    """Commands a landing when the estimates have been inside the zone, certain enough, for long enough.

    Parameters
    ----------
    zone : LandingZone
    landers : list of Lander
        Told to land all at once; empty for a dry run.
    report : callable
        Takes each event, as a dict.
    answer_within : float
        Seconds to wait for an answer before asking again.
    attempts : int
        Times to ask before giving up. Then, as after a refusal, the zone must be left and entered again.
    """

    def __init__(
        self,
        zone: LandingZone,
        landers: list[Lander],
        report: Callable[[dict], None],
        *,
        answer_within=1.0,
        attempts=5,
    ):
        self.zone, self._landers, self._report = zone, landers, report
        self._answer_within, self._attempts = answer_within, attempts
        self.state = State.WATCHING
        self.why = ""
        self._asked = 0
        self._ask_at = 0.0

    def update(self, estimate: Estimate, fix: Fix, now: float) -> State:
        """Take in the latest estimate and whatever answers have come; `now` in seconds."""
        inside = self._inside(estimate, fix)
        self._take_answers(now)
        if self.state is State.WATCHING:
            if inside:
                self._trigger(fix, now)
        elif self.state is State.ASKED:
            # Also between two attempts: a vehicle that has drifted out must not be sent a command made for
            # another place.
            if not inside:
                self._become(State.WATCHING, "the conditions no longer hold")
            elif now >= self._ask_at:
                self._ask_again(now)
        elif self.state is not State.LANDING and self._outside(fix):
            self._become(State.WATCHING, "the zone was left")
        return self.state

    def _outside(self, fix: Fix) -> bool:
        return fix.usable and fix.observed and not self.zone.contains(fix.position)

    def _inside(self, estimate: Estimate, fix: Fix) -> bool:
        if not fix.usable or not fix.observed:
            self.zone.reset()
            return False
        return self.zone.update(estimate)

    def _trigger(self, fix: Fix, now: float) -> None:
        where = {"x_m": float(fix.position[0]), "y_m": float(fix.position[1])}
        if not self._landers:
            self._become(State.WOULD_LAND, "", **where)
            return
        self._become(State.ASKED, "", **where)
        self._asked = 0
        self._ask_again(now)

    def _ask_again(self, now: float) -> None:
        if self._asked >= self._attempts:
            self._become(State.UNANSWERED, f"{self._attempts} commands sent")
            return
        heard = [lander.land(self._asked) for lander in self._landers]
        self._report({"event": "land", "confirmation": self._asked, "sent": any(heard)})
        self._asked += 1
        self._ask_at = now + self._answer_within

    def _take_answers(self, now: float) -> None:
        results = [
            answer.result
            for lander in self._landers
            for answer in lander.answers()
            if answer.command == NAV_LAND
        ]
        for result in results:
            if result == ACCEPTED and self._asked:  # in whatever state: the vehicle lands
                return self._become(State.LANDING, "accepted")
            if self.state is not State.ASKED:
                continue
            if result in (IN_PROGRESS, TEMPORARILY_REJECTED):
                self._ask_at = (
                    now + self._answer_within
                )  # it is there: give it time, then ask again
            else:
                return self._become(State.REFUSED, REASONS.get(result, f"result {result}"))

    def _become(self, state: State, why: str, **more) -> None:
        self.state, self.why = state, why
        self._report({"event": "landing", "state": state.value, "why": why, **more})
