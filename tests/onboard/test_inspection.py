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
        assert inspector.check(noise[:, ::-1]) is None
        assert inspector.check(np.zeros((24, 32, 3), np.uint8)) == "dark"
        assert inspector.check(np.full((24, 32, 3), 255, np.uint8)) == "bright"
        assert inspector.check(noise[:12]) == "size"
        assert inspector.check(np.zeros(20)) is None
        assert Inspector(None).check(noise[:12]) is None
