"""Floors to try a method on that it was not built on."""

from __future__ import annotations

import numpy as np
import pytest

from trexton.base.errors import ParameterError
from trexton.simulator.floor import LAYOUTS, Floor
from trexton.simulator.hall import paint_hall
from trexton.simulator.mats import HALL


@pytest.mark.parametrize("name", LAYOUTS)
def test_equal_generators_lay_equally_inside_the_hall(name):
    first, second = (LAYOUTS[name](np.random.default_rng(7)) for _ in range(2))
    assert first == second
    assert all(0 <= place.x - place.width / 2 <= place.x + place.width / 2 <= 5 for place in first)


def test_moved_mats_are_all_there_but_elsewhere():
    moved = LAYOUTS["moved"](np.random.default_rng(1))
    assert sorted(place.mat for place in moved) == sorted(place.mat for place in HALL)
    assert moved != HALL


def test_repeated_prints_are_equal_to_the_pixel(monkeypatch):
    from trexton.simulator import hall

    printed = {}

    def note(mat):
        def paint(size, rng):
            picture = mat(size, rng)
            printed.setdefault(mat.__name__, []).append(picture)
            return picture

        return paint

    monkeypatch.setattr(hall, "MATS", {name: note(mat) for name, mat in hall.MATS.items()})
    paint_hall(np.random.default_rng(2), LAYOUTS["repeats"](np.random.default_rng(2)))
    assert sorted(map(len, printed.values())) == [4, 4]
    for pictures in printed.values():
        assert all(np.array_equal(picture, pictures[0]) for picture in pictures)


def test_an_unknown_layout_names_the_known_ones():
    with pytest.raises(ParameterError, match="choose one of hall, moved"):
        Floor.painted("attic")
