"""Augmented recovery: averages by hand, injection, and a kidnapped vehicle."""

import numpy as np
import pytest
from small_room import observations, random_walk, rank_mixture

from trexton.base.errors import ParameterError
from trexton.localization.filters import ParticleFilter
from trexton.localization.methods import make
from trexton.localization.particle_parts import Augmented


def test_the_averages_follow_their_definition():
    recovery = Augmented(slow=0.1, fast=0.5)
    assert recovery.fitness == 1
    slow = fast = 0.0
    for seen, likelihood in enumerate((1.0, 0.9, 0.8, 0.2, 0.1, 1e-9), start=1):
        lost = recovery.update(np.log(likelihood))
        slow += max(0.1, 1 / seen) * (likelihood - slow)
        fast += max(0.5, 1 / seen) * (likelihood - fast)
        assert recovery.fitness == pytest.approx(fast / slow)
        assert lost == (fast / slow < 0.5)
    assert lost
    recovery.reset()
    assert recovery.fitness == 1


def kidnapped(recovery, seed):
    """Frames until the estimate is within half a metre again after a jump of four metres, and
    frames called lost.
    """
    rng = np.random.default_rng(seed)
    particle_filter = ParticleFilter(
        random_walk(np.eye(2) * 1e-3),
        rank_mixture(np.eye(2)[None] * 0.04),
        (0, 25, 0, 25),
        100,
        recovery=make("recovery", recovery),
        rng=rng,
    )
    for _ in range(100):
        belief = particle_filter.step(*observations(rng.normal([0.7, 0.7], 0.2)[None, None]))
    assert not belief.lost
    lost = 0
    for frame in range(200):
        belief = particle_filter.step(*observations(rng.normal([4.0, 4.0], 0.2)[None, None]))
        lost += belief.lost
        if np.hypot(*(particle_filter.position() - 4.0)) < 0.5:
            return frame, lost
    return 200, lost


def test_a_kidnapped_vehicle_is_found_again_and_lost_meanwhile():
    found = np.array([kidnapped("augmented", seed) for seed in range(20)])
    assert np.median(found[:, 0]) < 60 and found[:, 0].max() < 200
    # Three frames at least pass before the short-term average has fallen by half.
    slow = found[found[:, 0] > 6]
    assert len(slow) and (slow[:, 1] > 0).all()
    without = np.array([kidnapped("none", seed)[0] for seed in range(20)])
    assert np.median(without) > np.median(found[:, 0])


def test_bad_settings_are_refused():
    with pytest.raises(ParameterError):
        Augmented(slow=0.5, fast=0.1)
    with pytest.raises(ParameterError, match="lost_below"):
        Augmented(lost_below=2.0)
    with pytest.raises(ParameterError, match="choose"):
        make("recovery", "pray")
