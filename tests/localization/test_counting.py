"""Histograms of a whole flight: the same however it is cut, and none counted twice."""

from __future__ import annotations

import numpy as np
import pytest
from small_room import picture_flight

from trexton.localization import training
from trexton.localization.training import full_histograms
from trexton.vision.histograms import label_image, texton_histogram
from trexton.vision.textons import TextonDictionary


@pytest.fixture(scope="module")
def flight(tmp_path_factory):
    return picture_flight(tmp_path_factory.mktemp("room"), "room")


@pytest.fixture(scope="module")
def dictionary(flight):
    return TextonDictionary.learn(flight, 5, 4, rng=np.random.default_rng(1))


@pytest.fixture
def counted(monkeypatch, tmp_path):
    """Frames that were counted, one entry each."""
    monkeypatch.setenv("TREXTON_CACHE", str(tmp_path / "cache"))
    monkeypatch.setattr(training, "KEPT_FROM", 21)
    calls: list[int] = []

    def count(image, *words, **options):
        calls.append(1)
        return label_image(image, *words, **options)

    monkeypatch.setattr(training, "label_image", count)
    return calls


def test_other_textons_cells_or_frames_are_counted_anew(flight, dictionary, counted):
    calls = counted
    full_histograms(flight, dictionary)
    histograms = full_histograms(flight, dictionary)
    assert len(calls) == 48
    direct = [texton_histogram(image, dictionary) for image in flight.images()]
    np.testing.assert_array_equal(histograms, direct)
    parts = full_histograms(flight, dictionary, cells=2)
    assert len(calls) == 48  # whole images and quarters are counted in one pass
    direct = [texton_histogram(image, dictionary, cells=2) for image in flight.images()]
    np.testing.assert_array_equal(parts, direct)
    full_histograms(flight, dictionary, cells=3)
    assert len(calls) == 96
    full_histograms(flight, TextonDictionary(dictionary.textons[::-1].copy()))
    assert len(calls) == 144
    shifted = full_histograms(flight.select(slice(1, None)), dictionary)
    assert len(calls) == 191 and len(shifted) == 47


def test_a_short_flight_leaves_nothing_behind(flight, dictionary, counted, tmp_path):
    full_histograms(flight.select(slice(0, 20)), dictionary)
    assert not (tmp_path / "cache").exists()


def test_a_cache_that_cannot_be_written_stops_nothing(
    flight, dictionary, counted, tmp_path, monkeypatch, capsys
):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("TREXTON_CACHE", str(tmp_path / "file" / "cache"))
    assert full_histograms(flight, dictionary).shape == (48, 5)
    assert "nothing is kept there" in capsys.readouterr().err
