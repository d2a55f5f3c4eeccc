"""Choosing settings: errors by replay, frontier and choice by enumeration. No time is asserted."""

from __future__ import annotations

import re
import shlex

import numpy as np
import pytest
from conftest import small_flight

from trexton.base.errors import MapError, ParameterError
from trexton.base.streams import stream
from trexton.cli import main as cli
from trexton.companion.checks.tuning import (
    Bench,
    Tried,
    choose,
    commands,
    frontier,
    replayed_errors,
    search,
)
from trexton.flights.flight import Flight
from trexton.flights.writing import write_flight
from trexton.localization.training import train_map


def told_apart(frames: int = 90) -> Flight:
    """Histograms that say where they were taken, along a circle."""
    angle = np.linspace(0, 5 * np.pi, frames)
    place = 2 + 1.5 * np.column_stack([np.cos(angle), np.sin(angle)])
    centers = np.random.default_rng(3).uniform(0, 4, (8, 2))
    seen = np.exp(-np.square(place[:, None] - centers).sum(axis=2))
    return Flight(
        "circle", np.arange(frames), np.arange(frames) * 0.2, place, (0.0, 4.0, 0.0, 4.0),
        histograms=seen / seen.sum(axis=1, keepdims=True),
    )  # fmt: skip


def tried(error_m, frame_s, **setting):
    return Tried(setting, error_m, frame_s)


SOME = [
    tried(0.40, 2e-3, samples=400),
    tried(0.38, 9e-3, samples=0),
    tried(0.385, 8e-3, samples=800),
    tried(0.60, 1e-3, samples=50),
    tried(0.70, 3e-3, samples=100),
]


def test_the_frontier_holds_what_nothing_beats():
    assert [one.error_m for one in frontier(SOME)] == [0.60, 0.40, 0.385, 0.38]
    assert frontier(SOME[::-1]) == frontier(SOME)


def test_the_cheapest_of_the_good_is_chosen():
    assert choose(SOME) == SOME[2]  # within two per cent of the best, and cheaper
    assert choose(SOME, 5e-3) == SOME[0]
    assert choose(SOME, 1e-3) == SOME[3]
    with pytest.raises(ParameterError, match="takes 1 ms a frame, but 0.5 ms are to spend"):
        choose(SOME, 5e-4)


def test_replayed_errors_are_of_maps_that_did_not_see_the_frames():
    flight = told_apart()
    honest = train_map(flight, neighbors=1, rng=stream(1, "map"))
    errors = replayed_errors(honest, samples=None, rng=stream(1, "replay"))
    assert errors.ndim == 2 and errors.shape[1] == 2
    # Where every frame's histogram is noise, leaving the frame out leaves nothing to know it by.
    rng = np.random.default_rng(5)
    noise = Flight("noise", flight.frame, flight.time, flight.position, flight.area,
                   histograms=rng.dirichlet(np.ones(8), len(flight)))  # fmt: skip
    lost = replayed_errors(
        train_map(noise, neighbors=1, rng=stream(1, "map")),
        samples=None, rng=stream(1, "replay"),
    )  # fmt: skip
    assert np.hypot(*lost.T).mean() > 1.5 * np.hypot(*errors.T).mean()


def test_a_search_tries_the_usual_first_then_one_change_at_a_time():
    flight = told_apart()
    tried = search(flight, methods=["paper"], trials=8)
    usual, *others = (one.setting for one in tried)
    assert usual == {"method": "paper", "neighbors": 5, "particles": 50}
    assert [one["neighbors"] for one in others[:5]] == [1, 2, 3, 8, 12]
    # Particles are tried with the best of these.
    best = min(tried[:6], key=lambda one: one.error_m).setting
    assert [one for one in others[5:]] == [best | {"particles": n} for n in (100, 200)]
    # An error is a function of its setting alone, whoever asks for it and when.
    assert Bench(flight).attempt(others[2]).error_m == tried[3].error_m


def test_a_method_that_was_not_flown_is_named(monkeypatch, capsys):
    """The best of those that were flown was called the best."""

    def attempt(bench, setting):
        if setting["method"] == "fine":
            raise MapError("it learns from frames")
        return Tried(setting, 1.0, 1e-3)

    monkeypatch.setattr(Bench, "attempt", attempt)
    search(told_apart(), methods=["paper", "fine"], trials=2)
    assert "fine: not flown: it learns from frames" in capsys.readouterr().err


def test_every_method_is_tried_however_few_the_trials():
    tried = search(told_apart(), methods=["paper", "field"], trials=1)
    assert [one.setting["method"] for one in tried] == ["paper", "field"]


def test_a_search_ends_where_no_change_is_any_better_and_passes_over_what_cannot_be_flown(
    monkeypatch,
):
    def attempt(bench, setting):
        if setting["particles"] == 400:
            raise MapError("too many")
        return Tried(setting, abs(setting["neighbors"] - 8) + 10 / setting["particles"], 1e-3)

    monkeypatch.setattr(Bench, "attempt", attempt)
    tried = search(told_apart(), methods=["paper"], trials=1000)
    assert min(tried, key=lambda one: one.error_m).setting["neighbors"] == 8
    assert len(tried) < 25 and all(one.setting["particles"] != 400 for one in tried)


def test_settings_are_typed_as_they_are_printed():
    setting = {"method": "field", "textons": 30, "samples": 0, "cells": 2}
    train, fly = commands(setting, "room", "m.npz")
    field = "--method field --textons 30 --cells 2"
    assert train == f"trexton train room -o m.npz {field}"
    assert fly == "trexton onboard m.npz --samples 0"
    assert commands(setting, "my hall; a", "m.npz")[0].startswith("trexton train 'my hall; a' -o")
    assert (
        str(Tried(setting, 0.123, 0.002)) == f"  12.3 cm    2.000 ms a frame  {field} --samples 0"
    )
    assert str(Tried({"method": "paper"}, 12.3, 0.002)).startswith("  12.3 m ")


def test_bad_input_is_one_clear_error():
    flight = told_apart()
    with pytest.raises(ParameterError, match="unknown"):
        search(flight, methods=["guess"], trials=1)
    with pytest.raises(ParameterError, match="the seed is -1: expected .* from 0 to"):
        search(flight, trials=1, seed=-1)
    with pytest.raises(MapError, match="at least 12 s"):
        search(told_apart(30))
    with pytest.raises(ParameterError, match="no setting could be flown: no time"):
        search(flight, seconds=0)


def test_the_command_prints_the_frontier_and_how_to_fly_its_point(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    write_flight(told_apart(), tmp_path / "room")
    words = ["tune", "room", "--methods", "paper", "--quiet"]
    assert cli.main([*words, "--trials", "2", "--rate", "0.5"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("2 settings tried") and " ms a frame  --method paper" in printed
    train = re.search(r"^(trexton train .*)$", printed, re.M)[1]
    assert (
        cli.main([*shlex.split(train)[1:], "--quiet"]) == 0 and (tmp_path / "tuned.npz").is_file()
    )
    for wrong, told in (
        (["--rate", "-1"], "more than 0"), (["--headroom", "1"], "0.99 or less"),
        (["--trials", "0"], "1 or more"), (["--seconds", "0"], "more than 0"),
    ):  # fmt: skip
        assert cli.main([*words, *wrong]) == 1
        assert told in capsys.readouterr().err
    write_flight(small_flight(), tmp_path / "short")
    assert cli.main(["tune", "short", "--rate", "1"]) == 1
