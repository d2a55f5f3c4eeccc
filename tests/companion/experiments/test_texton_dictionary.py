"""The dictionary's page: values against plain definitions, figures against the record."""

from __future__ import annotations

import numpy as np
import pytest
from small_room import picture_flight

from trexton.base.files import canonical_json
from trexton.base.records import Record
from trexton.base.streams import stream
from trexton.companion.experiments import texton_dictionary
from trexton.vision.images import bgr_from_yuv
from trexton.vision.textons import TextonDictionary

OPTIONS = {"textons": 6, "images": 10, "patches_per_image": 200}


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    folder = tmp_path_factory.mktemp("room")
    return picture_flight(folder / "a", "survey"), picture_flight(
        folder / "b", "again", frames=20, turns=2.0
    )


@pytest.fixture(scope="module")
def record(flights, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TREXTON_CACHE", str(tmp_path_factory.mktemp("cache")))
        return texton_dictionary.run(*flights, texton_dictionary.Parameters(**OPTIONS))


def test_values(record, flights):
    values = record.values
    assert values["patches"] == 2000 and values["patches_per_image"] == 31 * 43
    assert sum(values["frequency"]) == pytest.approx(1)
    assert 1 <= values["fit"]["effective"] <= 6 and values["fit"]["error"] > 0


def test_the_dictionary_is_that_of_the_map(flights, record):
    strip = record.images["textons"]
    assert strip.shape == (6, 36, 3)
    dictionary = TextonDictionary.learn(
        flights[0], 6, rng=stream(1, "training"), images=10, patches_per_image=200
    )
    assert np.array_equal(strip, bgr_from_yuv(np.concatenate(list(dictionary.textons), axis=1)))


def test_equal_seeds_give_equal_records(record, flights, tmp_path, monkeypatch):
    monkeypatch.setenv("TREXTON_CACHE", str(tmp_path))
    again = texton_dictionary.run(*flights, texton_dictionary.Parameters(**OPTIONS))
    assert canonical_json(again.values) == canonical_json(record.values)


def test_figures_show_the_record(record, tmp_path):
    loaded = Record.load(record.save(tmp_path))
    labels = [axis.get_xlabel() for axis in texton_dictionary.textons(loaded).axes]
    assert labels == [
        f"{i}:  {100 * share:.1f} %" for i, share in enumerate(record.values["frequency"])
    ]
