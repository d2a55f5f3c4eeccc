"""The trigger's logic, by enumeration."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
import pytest

from trexton.base.errors import ParameterError
from trexton.localization import landing
from trexton.localization.estimate import Estimate
from trexton.localization.landing import GUST, LandingZone, TouchdownZone


@dataclass
class Guess:
    position: np.ndarray = field(default_factory=lambda: np.array([1.0, 2.0]))
    spread: np.ndarray = field(default_factory=lambda: np.array([0.1, 0.1]))
    lost: bool = False
    observed: bool = True


def test_the_trigger_fires_only_where_every_condition_holds():
    angles = np.linspace(0, 2 * np.pi, 7)
    distances, spreads = (0.0, 0.3, 0.5999, 0.6001, 5.0), (0.0, 0.4999, 0.5001, np.nan)
    cases = list(product(distances, angles, spreads, spreads, (False, True), (False, True)))
    fired = 0
    for distance, angle, sx, sy, lost, observed in cases:
        place = np.array([1.0, 2.0]) + distance * np.array([np.cos(angle), np.sin(angle)])
        zone = LandingZone((1.0, 2.0), 0.6, (0.5, 0.5))
        expected = distance < 0.6 and sx < 0.5 and sy < 0.5 and not lost and observed
        assert zone.update(Guess(place, np.array([sx, sy]), lost, observed)) is expected
        fired += expected
    assert 0 < fired < len(cases)


def test_each_axis_has_its_own_threshold():
    zone = LandingZone((1.0, 2.0), 0.6, (0.2, 0.9))
    assert zone.update(Guess(spread=np.array([0.1, 0.8])))
    assert not zone.update(Guess(spread=np.array([0.8, 0.1])))


@pytest.mark.parametrize("needed", [1, 2, 3])
def test_every_sequence_fires_after_that_many_in_a_row(needed):
    for sequence in product((False, True), repeat=6):
        zone = LandingZone((1.0, 2.0), consecutive=needed)
        fired = [zone.update(Guess(lost=not good)) for good in sequence]
        expected = [i + 1 >= needed and all(sequence[i + 1 - needed : i + 1]) for i in range(6)]
        assert fired == expected


def test_reset_forgets_the_row():
    zone = LandingZone((1.0, 2.0), consecutive=2)
    assert not zone.update(Guess())
    zone.reset()
    assert not zone.update(Guess())
    assert zone.update(Guess())


def test_a_position_that_is_not_a_number_never_lands():
    assert not LandingZone((1.0, 2.0)).update(Guess(position=np.array([np.nan, 2.0])))


@pytest.mark.parametrize(
    "arguments",
    [
        {"center": (np.nan, 0)},
        {"center": (1, 2, 3)},
        {"center": (0, 0), "radius": 0},
        {"center": (0, 0), "radius": np.inf},
        {"center": (0, 0), "spread": -1},
        {"center": (0, 0), "spread": (1, 1, 1)},
        {"center": (0, 0), "spread": (0.5, np.nan)},
        {"center": (0, 0), "consecutive": 0},
    ],
)
def test_nonsense_is_refused(arguments):
    with pytest.raises(ParameterError):
        LandingZone(**arguments)


def moving(position, velocity=(0.0, 0.0), deviation=0.05, **changes) -> Estimate:
    """An estimate that knows its velocity."""
    covariance = deviation**2 * np.eye(2)
    joint = np.block([[covariance, np.zeros((2, 2))], [np.zeros((2, 2)), covariance]])
    return Estimate(
        np.array(position, float), covariance, velocity=np.array(velocity, float), joint=joint,
        **changes,
    )  # fmt: skip


@pytest.mark.parametrize("offset", [(0.0, 0.0), (0.3, -0.2), (0.7, 0.1)])
def test_the_chance_of_a_touchdown_inside_is_that_of_many_touchdowns(offset, rng):
    zone = TouchdownZone((1, 2), 0.6, drift_s=0.5)
    estimate = moving(np.array(offset) + (1, 2), (0.2, 0.1), 0.1)
    place, covariance = estimate.ahead(0.5)
    drawn = rng.multivariate_normal(place, covariance + GUST**2 * np.eye(2), 100_000) - (1, 2)
    assert zone.chance(estimate) == pytest.approx((np.hypot(*drawn.T) < 0.6).mean(), abs=0.006)


def test_it_lands_before_the_middle_where_the_vehicle_flies_towards_it():
    zone = TouchdownZone((0, 0), 0.6, drift_s=0.5)
    towards, away = moving((-0.4, 0), (0.8, 0)), moving((0.1, 0), (0.9, 0))
    assert zone.accepts(towards) and not zone.accepts(away)
    assert LandingZone((0, 0), 0.6).accepts(away)


def test_less_is_asked_for_as_the_time_runs_out():
    zone = TouchdownZone((0, 0), 0.6, time_limit=60, settled_s=0)
    near = moving((0.4, 0.0))
    assert 0.8 < zone.chance(near) < 0.9
    assert not zone.update(near, 5.0)
    assert zone.update(near, 60.0)
    assert zone.wanted(600.0) == 0.8


def test_a_chance_that_still_grows_is_waited_for(monkeypatch):
    monkeypatch.setattr(landing, "CONFIDENCE", 0.7)
    monkeypatch.setattr(landing, "LEAST", 0.7)
    zone = TouchdownZone((0, 0), 0.6, drift_s=0.5)
    coming, over, leaving = (moving((x, 0), (0.6, 0)) for x in (-0.55, -0.3, -0.2))
    assert zone.chance(coming) > 0.7 and not zone.accepts(coming)
    assert zone.accepts(over) and zone.accepts(leaving)
    monkeypatch.setattr(landing, "LATER_S", 0.0)
    assert zone.accepts(coming)


def test_after_a_jump_it_waits_until_the_estimates_have_settled():
    zone = TouchdownZone((0, 0), 0.6, settled_s=1.5)
    here, elsewhere = moving((0, 0)), moving((3, 0))
    assert not zone.update(here, 0.0)  # where it was before nobody knows
    assert zone.update(here, 1.5) and zone.update(here, 1.58)
    assert not zone.update(elsewhere, 1.66)
    assert not zone.update(here, 1.74)  # it has jumped back, which is a jump too
    assert not zone.update(here, 3.20)
    assert zone.update(here, 3.30)
    zone.reset()
    assert not zone.update(here, 3.4)
    assert zone.update(here, 4.9)


def test_a_lost_estimate_must_settle_too_and_one_that_was_only_predicted_need_not():
    zone = TouchdownZone((0, 0), 0.6, settled_s=1.5)
    here = moving((0, 0))
    assert not zone.update(here, 0.0) and zone.update(here, 2.0)
    assert not zone.update(moving((0, 0), observed=False), 2.1)
    assert zone.update(here, 2.2)
    assert not zone.update(moving((0, 0), lost=True), 2.3)
    assert not zone.update(here, 2.4) and zone.update(here, 3.9)


def test_a_vehicle_that_flies_on_does_not_jump(monkeypatch):
    monkeypatch.setattr(landing, "LATER_S", 0.0)
    zone = TouchdownZone((0, 0), 0.6, drift_s=0, settled_s=0.5)
    path = [moving((x, 0), (10.0, 0)) for x in np.arange(-8.0, 0.1, 0.8)]
    assert any(zone.update(each, 0.08 * row) for row, each in enumerate(path))
    standing = [moving((x, 0)) for x in np.arange(-8.0, 0.1, 0.8)]
    zone.reset()
    assert not any(zone.update(each, 0.08 * row) for row, each in enumerate(standing))


def test_a_lost_or_unseen_frame_lands_nowhere():
    zone = TouchdownZone((0, 0), 0.6)
    assert zone.accepts(moving((0, 0)))
    assert not zone.accepts(moving((0, 0), lost=True))
    assert not zone.accepts(moving((0, 0), observed=False))


def test_an_estimate_without_velocity_stays_where_it_is():
    place, covariance = Estimate(np.ones(2), 0.01 * np.eye(2)).ahead(3.0)
    assert place.tolist() == [1, 1] and covariance[0, 0] == 0.01


@pytest.mark.parametrize(
    "bad",
    [
        {"drift_s": -1},
        {"time_limit": 0},
        {"settled_s": -1},
    ],
)
def test_nonsense_is_refused_by_the_touchdown_zone(bad):
    with pytest.raises(ParameterError, match="expected"):
        TouchdownZone((0, 0), 0.6, **bad)


def test_a_touchdown_asks_for_the_seconds_of_the_search():
    """Without them nothing would ever settle, and it never fired."""
    with pytest.raises(ParameterError, match="the seconds since the search began is nan"):
        TouchdownZone((0, 0)).update(moving((0, 0)))
