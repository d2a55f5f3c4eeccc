"""Stamps and clocks."""

from __future__ import annotations

import numpy as np
import pytest
from onboard_tools import Clock

from trexton.onboard.intake import StampKeeper
from trexton.onboard.tally import Tally


class TestClocks:
    def keeper(self):
        clock, wall, tally = Clock(100.0), Clock(1e9), Tally()
        return StampKeeper(tally, clock, wall), clock, wall, tally

    def pass_time(self, seconds, *clocks):
        for clock in clocks:
            clock.now += seconds

    def test_good_stamps_are_kept(self):
        keeper, clock, wall, tally = self.keeper()
        for _ in range(50):
            self.pass_time(0.08, clock, wall)
            assert keeper.keep(clock.now - 0.01) == clock.now - 0.01
        assert not tally.faults

    def test_stamps_of_another_clock_are_replaced(self):
        keeper, clock, wall, tally = self.keeper()
        assert keeper.keep(5e8) == 100.0
        assert tally["clock"] == 1

    def test_stamps_go_on_increasing_when_the_clock_goes_back(self):
        keeper, clock, wall, tally = self.keeper()
        stamps = []
        for step in range(20):
            self.pass_time(0.08, clock, wall)
            if step == 10:
                self.pass_time(-30.0, clock, wall)
            stamps.append(keeper.keep(clock.now))
        assert (np.diff(stamps) > 0).all()
        assert np.diff(stamps)[11:] == pytest.approx(0.08)
        assert tally["clock"] == 1

    def test_a_set_calendar_is_noticed_and_changes_nothing(self):
        keeper, clock, wall, tally = self.keeper()
        wall.now += 3600
        assert keeper.keep(100.0) == 100.0
        assert tally["clock"] == 1
        assert keeper.keep(100.08) == 100.08
        assert tally["clock"] == 1
