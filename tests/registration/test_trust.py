"""How far a fix on a picture of the floor is trusted, as learned from a flight."""

from __future__ import annotations

import numpy as np
import pytest

from trexton.base.errors import MapError
from trexton.registration.trust import FloorFix, Trust, learn_trust


def made(count: int, scale: float, floor: float):
    """Fixes whose errors have the raw variance times `scale` plus `floor`."""
    rng = np.random.default_rng(8)
    fixes, truth = [], []
    for raw in rng.uniform(1e-6, 2e-5, count):
        error = np.sqrt(scale * raw + floor) * rng.standard_normal(2)
        pose = np.array([*error, 1, 0, 0, 0])
        fixes.append(FloorFix(pose, raw * np.eye(2), 0.9, False, True))
        truth.append(np.zeros(2))
    return fixes, np.array(truth)


def test_learned_trust_makes_the_region_hold():
    fixes, truth = made(2000, 3.0, 1e-5)
    trust = learn_trust(fixes, truth, 1.0, Trust(scale=1.0, floor=0.0))
    assert trust.scale == pytest.approx(3.0, rel=0.4)
    held = [
        fix.position
        @ np.linalg.solve(trust.scale * fix.covariance + trust.floor * np.eye(2), fix.position)
        for fix in fixes
    ]
    assert np.mean(np.array(held) < 4.605) == pytest.approx(0.9, abs=0.005)
    assert trust.least == pytest.approx(0.54)


def test_too_few_located_frames_teach_nothing():
    fixes, truth = made(8, 1.0, 0.0)
    with pytest.raises(MapError, match="8 of 8 training frames.* 9 are needed"):
        learn_trust(fixes, truth, 1.0, Trust())


def test_from_nine_frames_the_region_that_holds_each_of_them_is_learned():
    fixes, truth = made(9, 3.0, 1e-5)
    trust = learn_trust(fixes, truth, 1.0, Trust(scale=1.0, floor=0.0))
    held = [
        fix.position
        @ np.linalg.solve(trust.scale * fix.covariance + trust.floor * np.eye(2), fix.position)
        for fix in fixes
    ]
    assert np.max(held) == pytest.approx(4.605)
