"""The landing: the paper's trigger (Sec. Triggered Landing), and what keeps it safe."""

from collections.abc import Callable, Mapping, Sequence
from enum import Enum
from typing import Protocol, runtime_checkable

import numpy as np

from trexton.localization.estimate import Estimate
from trexton.localization.landing import LandingZone
from trexton.onboard.fix import STALE_AFTER, Fix

ACCEPTED, TEMPORARILY_REJECTED, IN_PROGRESS = 0, 1, 5
REASONS = {
    1: "temporarily rejected", 2: "denied", 3: "unsupported", 4: "failed", 5: "in progress",
    6: "cancelled",
}  # fmt: skip
EXIT_RADII = 1.5  # from the centre: nearer, a position that jitters has not left the zone
EXIT_SECONDS = 3.0  # seconds outside after which a return is another visit
NO_TARGET = "no autopilot is there, or it is in doubt which one is ours or whether it flies"
ANSWER_WITHIN, ATTEMPTS = 1.0, 5  # seconds before asking again, and times to ask in one visit
ACK_TIMEOUT = 10.0  # an answer later than this after the latest command belongs to no command


@runtime_checkable
class LandingLink(Protocol):
    """What can be commanded to land, and answers: a sink that has these, as MAVLink's."""

    def land(self, confirmation: int) -> bool: ...

    def answers(self) -> Sequence[int]:
        """Results of landing commands since this was last asked, as MAV_RESULT counts them."""

    def phase(self) -> Mapping[str, object]:
        """What tells a landing from any other flight, and whether it is ``grounded``, if known."""


class State(Enum):
    """Where the landing stands."""

    WATCHING = "watching"
    WOULD_LAND = "WOULD LAND (dry run)"
    ASKED = "asked to land, no answer yet"
    LANDING = "LANDING"
    LANDED = "LANDED"
    REFUSED = "REFUSED"
    UNANSWERED = "NO ANSWER"
    ABORTED = "ABORTED"


class Commander:
    """Commands a landing when the estimates have been inside the zone, certain enough, for long
    enough.

    The promise is kept a *visit*: the first trigger begins one, and it ends when the vehicle has
    been well outside the zone for some seconds. Within a visit the command goes out `ATTEMPTS`
    times at most, however often the position flickers over the edge; a refusal is final, and so is
    a landing that was accepted and that the pilot ended.

    Parameters
    ----------
    landers : list of LandingLink
        Commanded to land, all at once, and asked whether they fly.
    report : callable
        Takes each event, as a dict.
    commands : bool
        False for a dry run.
    """

    def __init__(
        self,
        zone: LandingZone,
        landers: Sequence[LandingLink],
        report: Callable[[dict[str, object]], None],
        *,
        commands: bool = True,
    ):
        self.zone, self._landers, self._report = zone, landers, report
        self._commands, self.state, self.why = commands and bool(landers), State.WATCHING, ""
        self._sent = 0  # commands of this visit that a link took
        self._put_off = ""  # what the autopilot says who neither accepts nor refuses
        self._asked_at = -np.inf
        self._ask_at = self._landing_at = -np.inf
        self._outside_since: float | None = None  # on the clock that stamps the frames
        self._before: dict[tuple[int, str], object] = {}  # phases of the flight when it accepted
        self._flown: dict[tuple[int, str], object] = {}  # when it was first asked
        self._during: dict[tuple[int, str], object] = {}  # those that came of it
        self._held = False  # whether the last frame that came permitted a landing
        self._began: float | None = None  # the search, on the clock that stamps the frames

    def update(self, estimate: Estimate, fix: Fix, now: float) -> State:
        """Take in the latest estimate and what was answered; `now` in seconds, steady clock."""
        inside = self._inside(estimate, fix, now)
        self._take_answers(now)
        self._take_landed_state(now)
        if self._left(fix, now):
            late = self.state is State.LANDING and now - self._landing_at > EXIT_SECONDS
            if late and self._phases() == self._flown != {} and not self._lands():
                self._asked_at = -np.inf
                self._become(State.ABORTED, "accepted, and it flies on as before it was asked")
            # Landing, or landed, it has obeyed, wherever it is.
            stands = self.state is State.LANDED and any(self._grounded())
            if self.state is not State.LANDING and not stands:
                self._end_visit("the zone was left")
        elif inside and self.state in (State.WATCHING, State.ASKED):
            self._ask(fix, now)
        elif self.state is State.ASKED or self.why == NO_TARGET:
            # Also between two attempts: the command was made for another place than it is at now.
            self._become(State.WATCHING, "the conditions no longer hold")
        return self.state

    def _inside(self, estimate: Estimate, fix: Fix, now: float) -> bool:
        grounded = any(self._grounded())
        if grounded:  # a service starts long before take-off, with which the search begins
            self._began = None
        if grounded or not fix.usable or fix.age(now) > STALE_AFTER:
            self.zone.reset()
            self._held = False
            return False
        if self._began is None:
            self._began = fix.time
        if fix.observed:  # between the frames of a slow camera nothing new is said
            self._held = self.zone.update(estimate, fix.time - self._began)
        return self._held

    def _grounded(self) -> list[object]:
        """Which autopilots say that they stand: nothing is asked of them then."""
        return [lander.phase().get("grounded") for lander in self._landers]

    def _left(self, fix: Fix, now: float) -> bool:
        """Whether the vehicle has been outside long enough for the visit to be over."""
        if not fix.usable or fix.age(now) > STALE_AFTER:
            self._outside_since = None  # it may have come back
        elif fix.observed:
            distance = float(np.hypot(*(fix.position - self.zone.center)))
            if distance <= EXIT_RADII * self.zone.radius:
                self._outside_since = None
            elif self._outside_since is None:
                self._outside_since = fix.time
        return self._outside_since is not None and fix.time - self._outside_since >= EXIT_SECONDS

    def _end_visit(self, why: str) -> None:
        self._sent, self._put_off = 0, ""
        if self.state is not State.WATCHING:
            self._become(State.WATCHING, why)

    def _ask(self, fix: Fix, now: float) -> None:
        where = {"x_m": float(fix.position[0]), "y_m": float(fix.position[1])}
        if not self._commands:
            self._become(State.WOULD_LAND, "", **where)
        if not self._commands or now < self._ask_at:
            return
        if self._sent >= ATTEMPTS:
            why = f"{self._put_off}, " if self._put_off else ""
            ended = State.REFUSED if self._put_off else State.UNANSWERED
            self._become(ended, f"{why}{self._sent} commands sent")
            return
        self._ask_at = now + ANSWER_WITHIN
        if not self._sent:
            self._flown = self._phases()
        if any([lander.land(self._sent) for lander in self._landers]):
            if self.state is State.WATCHING:
                self._become(State.ASKED, "", **where)
            self._report({"event": "land", "confirmation": self._sent})
            self._asked_at, self.why = now, ""
            self._sent += 1
        elif self.why != NO_TARGET:
            self._become(State.WATCHING, NO_TARGET)

    def _phases(self) -> dict[tuple[int, str], object]:
        phases = ((n, lander.phase()) for n, lander in enumerate(self._landers))
        every = {(n, name): value for n, phase in phases for name, value in phase.items()}
        return {(n, name): value for (n, name), value in every.items() if name != "grounded"}

    def _is_aborted(self) -> bool:
        """Whether the flight is no longer in the phase that the command had brought about."""
        for name, value in self._phases().items():
            if name in self._during and value != self._during[name]:
                return True
            # It may have begun before an answer came: what says so itself needs no comparison.
            if value != self._before.setdefault(name, name[1] != "landing" and value):
                self._during[name] = value
        return False

    def _take_answers(self, now: float) -> None:
        results = [result for lander in self._landers for result in lander.answers()]
        if now - self._asked_at > ACK_TIMEOUT and self.state is not State.LANDING:
            return  # to nothing that was asked lately
        for result in results:
            if result == ACCEPTED:  # in whatever state: the vehicle lands
                if self.state not in (State.LANDING, State.LANDED, State.ABORTED):
                    self._begin_landing("accepted", now)
            elif result in (IN_PROGRESS, TEMPORARILY_REJECTED):
                self._ask_at = now + ANSWER_WITHIN  # it is there: give it time, then ask again
                self._put_off = REASONS[result]
            elif self.state is State.LANDING and self._lands():
                pass  # to a command that was repeated before the first was answered
            elif self.state is not State.LANDED:  # while it flickers, or after it had accepted
                self._become(State.REFUSED, REASONS.get(result, f"result {result}"))

    def _take_landed_state(self, now: float) -> None:
        grounded, pending = self._grounded(), (State.WATCHING, State.ASKED, State.UNANSWERED)
        if self._sent and self.state in pending and self._lands():  # the answer was lost
            self._begin_landing("by its own word, no answer came", now)
        if self.state is State.LANDING and any(grounded):
            self._become(State.LANDED, "it stands, or is no longer armed")
        elif self.state is State.LANDED and grounded and all(on is False for on in grounded):
            self._asked_at = -np.inf
            self._end_visit("in the air again")
        elif self.state is State.LANDING and self._is_aborted():
            self._become(State.ABORTED, "accepted, then ended by the pilot or the autopilot")

    def _begin_landing(self, why: str, now: float) -> None:
        self._before, self._during, self._landing_at = {}, {}, now
        self._become(State.LANDING, why)

    def _lands(self) -> bool:
        return any(lander.phase().get("landing") for lander in self._landers)

    def _become(self, state: State, why: str, **more: object) -> None:
        self.state, self.why = state, why
        self._report({"event": "landing", "state": state.value, "why": why, **more})
