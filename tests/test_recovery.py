"""Augmented recovery: averages by hand, injection, and a kidnapped vehicle."""

import numpy as np
import pytest

from trexton.errors import ParameterError
from trexton.particles import GaussianMotion, ParticleFilter, RankMixture
from trexton.recovery import AugmentedRecovery, make_recovery


def test_the_averages_follow_their_definition():
    recovery = AugmentedRecovery(slow=0.1, fast=0.5)
    assert recovery.fit == 1
    slow = fast = 0.0
    for seen, likelihood in enumerate((1.0, 0.9, 0.8, 0.2, 0.1, 1e-9), start=1):
        lost = recovery.update(np.log(likelihood))
        slow += max(0.1, 1 / seen) * (likelihood - slow)
        fast += max(0.5, 1 / seen) * (likelihood - fast)
        assert recovery.fit == pytest.approx(fast / slow)
        assert lost == (fast / slow < 0.5)
    assert lost
    recovery.reset()
    assert recovery.fit == 1


def kidnapped(recovery, seed):
    """Frames until the estimate is within half a metre again after a jump of four metres, and frames called lost."""
    rng = np.random.default_rng(seed)
    particle_filter = ParticleFilter(
        GaussianMotion(np.eye(2) * 1e-3),
        RankMixture(np.eye(2)[None] * 0.04),
        (0, 25, 0, 25),
        100,
        recovery=make_recovery(recovery),
        rng=rng,
    )
    for _ in range(100):
        belief = particle_filter.step(rng.normal([0.7, 0.7], 0.2)[None])
    assert not belief.lost
    lost = 0
    for frame in range(200):
        belief = particle_filter.step(rng.normal([4.0, 4.0], 0.2)[None])
        lost += belief.lost
        if np.hypot(*(particle_filter.estimate() - 4.0)) < 0.5:
            return frame, lost
    return 200, lost


def test_a_kidnapped_vehicle_is_found_again_and_lost_meanwhile():
    found = np.array([kidnapped("augmented", seed) for seed in range(20)])
    assert np.median(found[:, 0]) < 60 and found[:, 0].max() < 200
    # Three frames at least pass before the short-term average has fallen by half.
    slow = found[found[:, 0] > 6]
    assert len(slow) and (slow[:, 1] > 0).all()
    without = np.array([kidnapped(None, seed)[0] for seed in range(20)])
    assert np.median(without) > np.median(found[:, 0])


def test_bad_settings_are_refused():
    with pytest.raises(ParameterError):
        AugmentedRecovery(slow=0.5, fast=0.1)
    with pytest.raises(ParameterError, match="choose"):
        make_recovery("pray")
