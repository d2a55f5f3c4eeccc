"""Names of one's own: entry points of an installed package, and ``module:name``."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from small_room import histogram_flight

from trexton.base import plugins
from trexton.base.errors import MapError, ParameterError
from trexton.localization.map_files import load_map, save_map
from trexton.localization.methods import make, name_of
from trexton.localization.training import train_map

SOURCE = """
from dataclasses import dataclass

from trexton.base.options import option
from trexton.localization.motion import RandomWalk


@dataclass(eq=False)
class Brisk(RandomWalk):
    times: float = option(1.5, "process deviations", above=0)
"""
TABLE = {"here": "trexton.base.errors:MapError"}


@pytest.fixture
def brisk(installed):
    """A package with a motion model, and its folder."""
    return installed("brisk_walks", SOURCE, "motion", "brisk = brisk_walks:Brisk")


def test_an_installed_part_has_a_name_like_those_of_the_library(brisk):
    part = make("motion", "brisk", times="2")
    assert part.times == 2.0 and name_of("motion", part) == "brisk"
    with pytest.raises(ParameterError, match="random-walk, singer, brisk"):
        make("motion", "sluggish")


def test_a_map_flies_after_its_module_was_named(brisk, tmp_path, monkeypatch):

    (brisk / "own_walks.py").write_text(SOURCE)
    flight = histogram_flight("hall", frames=40)
    texton_map = train_map(flight, rng=np.random.default_rng(1), motion="own_walks:Brisk")
    path = save_map(texton_map, tmp_path / "map.npz")
    sys.modules.pop("own_walks")
    with pytest.raises(MapError, match="--plugin own_walks"):
        load_map(path)
    monkeypatch.setenv(plugins.PLUGINS, "")
    plugins.import_plugins("own_walks")
    assert type(load_map(path).parts["motion"]).__name__ == "Brisk"
    with pytest.raises(ParameterError, match="no_such_module"):
        plugins.import_plugins("no_such_module")


def test_what_is_none_is_one_clear_error():
    assert plugins.resolve("errors", "here", TABLE) is MapError
    assert plugins.resolve("errors", "trexton.base.errors:ParameterError", TABLE) is ParameterError
    for name, message in (
        ("there", "choose one of here, or module:name"),
        ("trexton.base.errors:Nothing", "has no Nothing"),
        ("no_such_module:Error", "check its name"),
    ):
        with pytest.raises(ParameterError, match=message):
            plugins.resolve("errors", name, TABLE)
