"""Frames that cannot be used are told from those that can."""

from __future__ import annotations

import numpy as np

from trexton.onboard.intake import Inspector


class TestInspector:
    def test_each_fault_and_none(self, rng):
        inspector = Inspector((24, 32))
        noise = rng.integers(0, 256, (24, 32, 3), dtype=np.uint8)
        assert inspector.check(noise) is None
        assert inspector.check(noise) == "frozen"
        assert inspector.frozen == 1
        assert inspector.check(noise[:, ::-1]) is None
        assert inspector.frozen == 0
        assert inspector.check(np.zeros((24, 32, 3), np.uint8)) == "dark"
        assert inspector.check(np.full((24, 32, 3), 255, np.uint8)) == "bright"
        assert inspector.check(noise[:12]) == "size"
        assert inspector.check(np.zeros(20)) is None
        assert Inspector(None).check(noise[:12]) is None

    def test_a_torn_frame_is_told_from_a_bar_that_stays(self, rng):
        inspector = Inspector((96, 32))
        first, second, third, fourth = rng.integers(0, 256, (4, 96, 32, 3), dtype=np.uint8)
        assert inspector.check(first) is None
        assert inspector.check(np.concatenate([second[:48], first[48:]])) == "torn"
        assert inspector.check(second) is None  # whole, though its upper half has come before
        assert inspector.check(third) is None
        assert inspector.check(np.concatenate([third[:72], fourth[72:]])) == "torn"
        inspector, bar = Inspector((96, 32)), first[:40]
        found = [inspector.check(np.concatenate([each[40:], bar])) for each in (first, second)]
        found += [inspector.check(np.concatenate([each[40:], bar])) for each in (third, fourth)]
        assert found == [None, "torn", None, None]  # once, until it is known for a bar
        inspector, black = Inspector((96, 32)), np.zeros_like(bar)
        for each in (first, second, third):
            assert inspector.check(np.concatenate([black, each[40:]])) is None
