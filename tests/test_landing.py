"""The trigger's logic, by enumeration."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import product

import numpy as np
import pytest

from trexton.errors import ParameterError
from trexton.landing import LandingZone


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
