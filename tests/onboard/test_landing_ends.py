"""Landings that end: taken over, answered twice, a second flight; and those of a dry run."""

import pytest
from onboard_tools import make_estimate, make_fix
from test_onboard_landing import INSIDE, OUTSIDE, Autopilot, Flight

from trexton.localization.landing import LandingZone
from trexton.onboard.commander import Commander, State


@pytest.mark.parametrize("shown", [{}, {"mode": 9}])
def test_a_landing_that_was_accepted_and_left_is_over(shown):
    """A takeover between two heartbeats, or before the second answer, stood as LANDING."""
    flight = Flight()
    flight.autopilot.flies = {"mode": 3, "landing": False} | shown
    flight.autopilot.flies["mode"] = 3
    flight.fly(3)
    flight.autopilot.flies |= shown
    flight.fly(9)
    flight.autopilot.answer(0)
    assert flight.fly(5) is State.LANDING
    flight.autopilot.flies |= {"mode": 3}
    assert flight.fly(60, position=OUTSIDE) is State.WATCHING and "ABORTED" in flight.states
    assert flight.fly(5) is State.ASKED


def test_a_later_answer_does_not_refuse_what_lands():
    """To the command that was repeated before the first was answered."""
    flight = Flight()
    flight.autopilot.flies = {"landing": False}
    flight.fly(14)
    flight.autopilot.answer(0)
    flight.autopilot.flies = {"landing": True}
    flight.fly(2)
    flight.autopilot.answer(4)
    assert flight.fly(5) is State.LANDING
    flight.autopilot.grounded = True
    assert flight.fly(2) is State.LANDED


def test_a_second_flight_lands_where_nobody_says_that_it_flies():
    """Disarmed it stood, armed again nothing was known: it stood as LANDED for ever."""
    flight = Flight()
    flight.fly(3)
    flight.autopilot.answer(0)
    flight.autopilot.flies = {"mode": 9}
    assert flight.fly(3) is State.LANDING
    flight.autopilot.grounded = True
    assert flight.fly(50) is State.LANDED
    flight.autopilot.grounded, flight.autopilot.flies = None, {"mode": 3}
    assert flight.fly(50, position=OUTSIDE) is State.WATCHING
    assert flight.fly(3) is State.ASKED


def test_a_dry_run_asks_whether_it_flies():
    autopilot, said = Autopilot(), []
    commander = Commander(LandingZone(INSIDE), [autopilot], said.append, commands=False)
    for now, grounded, state in ((1, True, State.WATCHING), (2, False, State.WOULD_LAND)):
        autopilot.grounded = grounded
        fix = make_fix(float(now), INSIDE)
        assert commander.update(make_estimate(INSIDE, (0.2, 0.2)), fix, now) is state
    assert autopilot.confirmations == []


def test_an_answer_that_comes_outside_is_no_end():
    """The phase of the landing is not heard yet: it was called ended, and commanded again."""
    flight = Flight()
    flight.autopilot.flies = {"mode": 3, "landing": False}
    flight.fly(4)
    flight.fly(38, position=OUTSIDE)
    flight.autopilot.answer(0)
    assert flight.fly(5, position=OUTSIDE) is State.LANDING
    flight.autopilot.flies = {"mode": 9, "landing": True}
    assert flight.fly(50, position=OUTSIDE) is State.LANDING and "ABORTED" not in flight.states
