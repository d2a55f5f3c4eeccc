"""The landing: the trigger, the command, and an autopilot that accepts, denies, delays or says
nothing.
"""

from __future__ import annotations

import numpy as np
import pytest
from onboard_tools import make_estimate, make_fix

from trexton.localization.landing import LandingZone
from trexton.onboard.commander import Commander, State

INSIDE, OUTSIDE = (2.5, 2.5), (4.5, 2.5)


class Autopilot:
    """Takes landing commands and answers when told to."""

    def __init__(self):
        self.confirmations, self.queue, self.grounded = [], [], None
        self.connected, self.flies = True, {"mode": 3}

    def land(self, confirmation: int) -> bool:
        if self.connected:
            self.confirmations.append(confirmation)
        return self.connected

    def answers(self) -> list:
        queue, self.queue = self.queue, []
        return queue

    def phase(self) -> dict:
        return self.flies | {"grounded": self.grounded}

    def answer(self, result: int) -> None:
        self.queue.append(result)


class Elapsed(LandingZone):
    """Remembers when it was asked."""

    def __init__(self):
        super().__init__(INSIDE)
        self.asked = []

    def update(self, estimate, elapsed_s=0.0):
        self.asked.append(elapsed_s)
        return False


def test_the_zone_is_told_the_time_of_the_frames_since_the_search_began():
    zone = Elapsed()
    commander = Commander(zone, [], [].append)
    for now, more in ((7.0, {"lost": True}), (8.0, {}), (8.5, {"observed": False}), (9.0, {})):
        estimate = make_estimate(INSIDE, (0.2, 0.2), more.get("lost", False))
        commander.update(estimate, make_fix(now, INSIDE, **more), now)
    assert zone.asked == [0.0, 1.0]


def test_the_search_begins_at_take_off_where_the_autopilot_tells():
    """The service waits on the ground for as long as it likes."""
    zone, autopilot = Elapsed(), Autopilot()
    commander = Commander(zone, [autopilot], [].append)
    for now, grounded in (
        (7.0, True),
        (90.0, True),
        (91.0, False),
        (92.0, None),
        (93.0, True),
        (95.0, False),
    ):
        autopilot.grounded = grounded
        commander.update(make_estimate(INSIDE, (0.2, 0.2)), make_fix(now, INSIDE), now)
    assert zone.asked == [0.0, 1.0, 0.0]


class Flight:
    """A commander and the estimates it is fed, 0.1 s apart."""

    def __init__(self, armed=True, consecutive=3):
        self.autopilot, self.events, self.now = Autopilot(), [], 0.0
        zone = LandingZone(INSIDE, 0.6, 0.6, consecutive)
        self.commander = Commander(zone, [self.autopilot] if armed else [], self.events.append)

    def fly(
        self, frames=1, position=INSIDE, spread=(0.2, 0.2), lost=False, observed=True, stale=False
    ) -> State:
        for _ in range(frames):
            estimate = make_estimate(position, spread, lost, observed)
            fix = make_fix(
                self.now,
                position,
                np.diag(np.square(spread)),
                lost=lost,
                observed=observed,
                stale=stale,
            )
            self.commander.update(estimate, fix, self.now)
            self.now += 0.1
        return self.commander.state

    @property
    def states(self) -> list[str]:
        return [event["state"] for event in self.events if event["event"] == "landing"]


class TestTrigger:
    def test_a_number_of_consecutive_estimates(self):
        flight = Flight()
        assert flight.fly(2) is State.WATCHING
        flight.fly(position=OUTSIDE)
        assert flight.fly(2) is State.WATCHING
        assert flight.fly() is State.ASKED
        assert flight.autopilot.confirmations == [0]

    @pytest.mark.parametrize(
        "condition",
        [
            {"position": OUTSIDE},
            {"spread": (0.7, 0.2)},
            {"spread": (0.2, 0.7)},
            {"lost": True},
            {"stale": True},
            {"position": (np.nan, 2.5)},
        ],
    )
    def test_each_condition_alone_keeps_it_from_landing(self, condition):
        flight = Flight()
        assert flight.fly(20, **condition) is State.WATCHING
        flight.fly(2)
        flight.fly(1, **condition)
        assert flight.fly(2) is State.WATCHING
        assert flight.autopilot.confirmations == []

    def test_what_is_predicted_between_frames_neither_counts_nor_begins_the_row_again(self):
        flight = Flight()
        assert flight.fly(20, observed=False) is State.WATCHING
        for _ in range(2):  # a camera of half the rate
            flight.fly()
            assert flight.fly(observed=False) is State.WATCHING
        assert flight.fly() is State.ASKED
        assert flight.fly(observed=False) is State.ASKED
        assert flight.fly(observed=False, stale=True) is State.WATCHING

    def test_dry_run_only_says_so(self):
        flight = Flight(armed=False)
        assert flight.fly(30) is State.WOULD_LAND
        assert flight.states == [State.WOULD_LAND.value]
        assert flight.events[0]["x_m"] == 2.5
        assert flight.fly(35, position=OUTSIDE) is State.WATCHING
        assert flight.fly(3) is State.WOULD_LAND


class TestAnswers:
    def test_accepted(self):
        flight = Flight()
        flight.fly(3)
        flight.autopilot.answer(0)
        assert flight.fly() is State.LANDING
        flight.autopilot.flies = {"mode": 9}
        assert flight.fly(50, position=OUTSIDE) is State.LANDING
        assert flight.autopilot.confirmations == [0]

    @pytest.mark.parametrize(
        ("result", "why"),
        [(2, "denied"), (3, "unsupported"), (4, "failed"), (6, "cancelled"), (9, "result 9")],
    )
    def test_refused_is_reported_and_not_repeated_until_the_zone_is_entered_again(
        self, result, why
    ):
        flight = Flight()
        flight.fly(3)
        flight.autopilot.answer(result)
        assert flight.fly(50) is State.REFUSED
        assert flight.commander.why == why
        flight.fly(1, observed=False)
        assert flight.fly(50) is State.REFUSED
        assert flight.autopilot.confirmations == [0]
        flight.fly(1, position=OUTSIDE)
        assert flight.fly(10) is State.REFUSED  # a flicker is no departure
        flight.fly(35, position=OUTSIDE)
        assert flight.fly(3) is State.ASKED
        assert flight.autopilot.confirmations == [0, 0]

    @pytest.mark.parametrize("unseen", [{"lost": True}, {"observed": False, "stale": True}])
    def test_one_place_outside_and_none_after_it_are_no_departure(self, unseen):
        """A refused landing was commanded again, over a zone that was never left."""
        flight = Flight()
        flight.fly(3)
        flight.autopilot.answer(2)
        flight.fly(20)
        flight.fly(1, position=OUTSIDE)
        flight.fly(40, **unseen)
        assert flight.fly(20) is State.REFUSED
        assert flight.autopilot.confirmations == [0]

    def test_silence_is_asked_again_with_confirmation_counted_up_and_then_given_up(self):
        flight = Flight()
        flight.fly(3)
        assert flight.fly(39) is State.ASKED
        assert flight.autopilot.confirmations == [0, 1, 2, 3]
        assert flight.fly(30) is State.UNANSWERED
        assert flight.autopilot.confirmations == [0, 1, 2, 3, 4]
        flight.autopilot.answer(0)  # a late answer still means that it lands
        assert flight.fly() is State.LANDING

    @pytest.mark.parametrize("result", [1, 5])
    def test_in_progress_or_temporarily_rejected_is_given_time(self, result):
        flight = Flight()
        flight.fly(3)
        flight.fly(8)
        flight.autopilot.answer(result)
        flight.fly(8)
        assert flight.autopilot.confirmations == [0]
        flight.fly(5)
        assert flight.autopilot.confirmations == [0, 1]
        flight.autopilot.answer(0)
        assert flight.fly() is State.LANDING

    @pytest.mark.parametrize(
        ("result", "state", "why"),
        [
            (1, State.REFUSED, "temporarily rejected, 5 commands sent"),
            (5, State.REFUSED, "in progress, 5 commands sent"),
            (None, State.UNANSWERED, "5 commands sent"),
        ],
    )
    def test_what_is_said_at_the_end_is_what_happened(self, result, state, why):
        flight = Flight()
        for _ in range(100):
            before = len(flight.autopilot.confirmations)
            flight.fly()
            if result is not None and len(flight.autopilot.confirmations) > before:
                flight.autopilot.answer(result)
        assert (flight.commander.state, flight.commander.why) == (state, why)

    def test_only_commands_that_went_out_count(self):
        """The link comes up eleven seconds after the landing was due: it still gets all five."""
        flight = Flight()
        flight.autopilot.connected = False
        assert flight.fly(110) is State.WATCHING and "no autopilot" in flight.commander.why
        assert len(flight.states) == 1  # it is said once, and nothing was asked
        flight.fly(10, position=OUTSIDE)
        assert flight.commander.why == "the conditions no longer hold"
        flight.fly(10)
        flight.autopilot.connected = True
        assert flight.fly(15) is State.ASKED and flight.commander.why == ""
        assert flight.fly(60) is State.UNANSWERED
        assert flight.autopilot.confirmations == [0, 1, 2, 3, 4]

    @pytest.mark.parametrize(
        ("down", "ended"),
        [
            ({"mode": 9}, {"mode": 5}),
            ({"mode": 3, "landing": True}, {"mode": 3, "landing": False}),
            ({"mode": 9, "landing": True}, {"mode": 3, "landing": True}),
        ],
    )
    def test_a_landing_that_the_pilot_ends_is_over_and_not_asked_for_again(self, down, ended):
        flight = Flight()
        flight.autopilot.flies = {"mode": 3, "landing": False}
        flight.fly(3)
        flight.autopilot.answer(0)
        assert flight.fly(5) is State.LANDING
        flight.autopilot.flies = down
        assert flight.fly(20) is State.LANDING
        flight.autopilot.flies = ended
        assert flight.fly(50) is State.ABORTED
        assert flight.autopilot.confirmations == [0]
        flight.fly(35, position=OUTSIDE)
        assert flight.fly(3) is State.ASKED

    @pytest.mark.parametrize("mode", [{}, {"mode": 3}])
    def test_a_landing_whose_answer_came_late_can_be_ended_too(self, mode):
        """It had begun when the command was repeated, and stood as LANDING for ever after."""
        flight = Flight()
        flight.autopilot.flies = mode | {"landing": False}
        flight.fly(3)
        flight.autopilot.flies = {name: 9 for name in mode} | {"landing": True}
        flight.fly(12)
        flight.autopilot.answer(0)
        assert flight.fly(5) is State.LANDING
        flight.autopilot.flies = mode | {"landing": False}
        assert flight.fly(50) is State.ABORTED
        assert flight.autopilot.confirmations == [0]

    @pytest.mark.parametrize("result", [None, 5, 1])
    def test_a_pilot_who_ends_a_landing_whose_answer_was_lost_is_not_overruled(self, result):
        flight = Flight()
        flight.autopilot.flies = {"mode": 3, "landing": False}
        flight.fly(3)
        if result is not None:
            flight.autopilot.answer(result)
        flight.autopilot.flies = {"mode": 9, "landing": True}
        assert flight.fly(5) is State.LANDING
        flight.autopilot.flies = {"mode": 3, "landing": False}
        assert flight.fly(60) is State.ABORTED
        assert flight.autopilot.confirmations == [0]

    def test_a_mode_chosen_before_the_answer_is_no_end_of_the_landing(self):
        flight = Flight()
        flight.fly(3)
        flight.autopilot.flies = {"mode": 5}
        flight.fly(3)
        flight.autopilot.answer(0)
        flight.fly(3)
        flight.autopilot.flies = {"mode": 9}
        assert flight.fly(20) is State.LANDING

    def test_no_further_command_once_the_conditions_no_longer_hold(self):
        flight = Flight()
        flight.fly(3)
        assert flight.fly(40, position=OUTSIDE) is State.WATCHING
        assert flight.autopilot.confirmations == [0]

    def test_an_answer_to_nothing_that_was_asked_means_nothing(self):
        flight = Flight()
        flight.autopilot.answer(0)
        assert flight.fly(2) is State.WATCHING


class TestFaults:
    def test_an_old_position_lands_nothing(self):
        flight = Flight()
        for _ in range(20):
            fix = make_fix(flight.now - 1.2, INSIDE)  # a step of 1.2 s: not stale by its own word
            flight.commander.update(make_estimate(INSIDE), fix, flight.now)
            flight.now += 0.1
        assert flight.autopilot.confirmations == []

    def test_at_the_edge_five_times_at_most_with_confirmations_counted_up(self):
        flight = Flight(consecutive=1)
        near = (INSIDE[0] + 0.65, INSIDE[1])  # just outside
        for number in range(600):
            flight.fly(position=near if number % 2 else INSIDE)
        assert flight.autopilot.confirmations == [0, 1, 2, 3, 4]

    def test_a_denial_during_a_flicker_is_heard(self):
        flight = Flight(consecutive=1)
        flight.fly()
        flight.fly(observed=False)
        flight.autopilot.answer(2)
        assert flight.fly(observed=False) is State.REFUSED
        assert flight.fly(50) is State.REFUSED and flight.autopilot.confirmations == [0]

    def test_a_late_answer_means_nothing(self):
        flight = Flight(consecutive=1)
        flight.fly()
        flight.fly(200, observed=False, stale=True)
        flight.autopilot.answer(0)
        assert flight.fly(observed=False, stale=True) is State.WATCHING

    def test_accepted_then_failed_is_refused(self):
        flight = Flight()
        flight.fly(3)
        flight.autopilot.answer(0)
        assert flight.fly() is State.LANDING
        flight.autopilot.answer(4)
        assert flight.fly() is State.REFUSED and flight.commander.why == "failed"

    def test_the_ground_is_not_landed_on_and_ends_a_landing(self):
        flight = Flight()
        flight.autopilot.grounded = True
        assert flight.fly(30) is State.WATCHING and flight.autopilot.confirmations == []
        flight.autopilot.grounded = False
        flight.fly(3)
        flight.autopilot.answer(0)
        flight.fly()
        flight.autopilot.grounded = True
        assert flight.fly() is State.LANDED


def test_a_visit_ends_by_the_clock_of_the_flight():
    """Replayed as fast as possible, 40 s of flight take none: what is said must be the same."""
    events = []
    commander = Commander(LandingZone(INSIDE, 0.6, 0.6, 3), [], events.append)
    for number in range(400):
        place = OUTSIDE if 100 <= number < 200 else INSIDE
        fix = make_fix(0.1 * number, place, captured=7.0 + 1e-4 * number)
        commander.update(make_estimate(place), fix, 7.0 + 1e-4 * number)
    assert [event["state"] for event in events].count(State.WOULD_LAND.value) == 2
