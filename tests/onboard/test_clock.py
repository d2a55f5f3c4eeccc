"""Stamps and clocks."""

from __future__ import annotations

import numpy as np
import pytest
from onboard_tools import Clock

from trexton.onboard.intake import StampKeeper
from trexton.onboard.tally import Tally


class TestClocks:
    def keeper(self):
        clock, tally = Clock(100.0), Tally()
        return StampKeeper(tally, clock), clock, tally

    def test_good_stamps_are_kept(self):
        keeper, clock, tally = self.keeper()
        for _ in range(50):
            clock.now += 0.08
            assert keeper.keep(clock.now - 0.01) == clock.now - 0.01
        assert not tally.faults

    def test_stamps_of_another_clock_are_replaced(self):
        keeper, clock, tally = self.keeper()
        assert keeper.keep(5e8) == 100.0
        assert tally["clock"] == 1

    def test_stamps_go_on_increasing_when_the_clock_goes_back(self):
        keeper, clock, tally = self.keeper()
        stamps = []
        for step in range(20):
            clock.now += 0.08
            if step == 10:
                clock.now += -30.0
            stamps.append(keeper.keep(clock.now))
        assert (np.diff(stamps) > 0).all()
        assert np.diff(stamps)[11:] == pytest.approx(0.08)
        assert tally["clock"] == 1
