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

    def test_a_camera_that_hangs_in_a_ring_of_buffers_is_frozen(self, rng):
        """Its pictures were taken for new ones: a metre off, and sure to a centimetre."""
        inspector = Inspector((24, 32))
        ring = [rng.integers(0, 256, (24, 32, 3), dtype=np.uint8) for _ in range(4)]
        assert [inspector.check(each) for each in ring] == [None] * 4
        assert [inspector.check(each) for each in 3 * ring] == ["frozen"] * 12
