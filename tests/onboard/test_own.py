"""Sinks and parts of a person's own: found by name, flown, and never failing in silence."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
from conftest import ROOT
from small_room import histogram_flight

from trexton.cli.main import main
from trexton.cli.preflight import preflight
from trexton.flights.writing import write_flight

OWN = """
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from trexton.base.options import Options, option
from trexton.localization.measurement import RankMixture
from trexton.onboard.sinks import Sink


@dataclass(eq=False)
class Student(RankMixture):
    \"\"\"Heavier tails.\"\"\"

    freedom: float = option(4.0, "degrees of freedom", above=0)

    def mixture(self, places, positions):
        return super().mixture(places, positions) * (self.freedom + 1) / self.freedom


@dataclass(frozen=True)
class LoudOptions(Options):
    \"\"\"loud\"\"\"

    prefix: ClassVar[str] = "loud"
    word: str = option("fix", "before each line")


class Loud(Sink):
    addresses = {"loud:FILE": "lines"}
    options = LoudOptions

    def __init__(self, path, options):
        self.name, self.path, self.word = f"loud:{path}", path, options.word

    @classmethod
    def make(cls, address, options, around):
        return cls(address, options)

    def open(self):
        open(self.path, "w").close()

    def write(self, fix):
        with open(self.path, "a") as stream:
            print(self.word, *fix.position, file=stream)


class Broken(Loud):
    options = Options

    def __init__(self, path, options):
        self.name = "broken"

    def open(self):
        pass

    def write(self, fix):
        fix.position + "metres"


class Unplugged(Broken):
    def write(self, fix):
        raise ConnectionError("the cable is out")


class Tower(Loud):
    autopilot = True
"""


@pytest.fixture
def place(tmp_path):
    (tmp_path / "mine.py").write_text(OWN)
    write_flight(histogram_flight("hall", frames=80), tmp_path / "hall")
    return tmp_path


def trexton(place, *words):
    return subprocess.run(
        [sys.executable, "-m", "trexton", *words],
        cwd=place, capture_output=True, text=True,
        env=os.environ | {"PYTHONPATH": str(ROOT), "TREXTON_CACHE": str(place / "cache")},
    )  # fmt: skip


def test_a_part_of_ones_own_is_trained_and_flown(place):
    done = trexton(place, "train", "hall", "-o", "map.npz", "--set", "measurement=mine:Student",
                   "measurement.freedom=3")  # fmt: skip
    assert done.returncode == 0, done.stderr
    fly = ("onboard", "map.npz", "--camera", "hall", "--frames", "5", "--output", "csv:fixes.csv")
    refused = trexton(place, *fly)
    assert refused.returncode == 1 and "name its module with --plugin mine" in refused.stderr
    assert "Traceback" not in refused.stderr
    done = trexton(place, *fly, "--plugin", "mine")
    assert done.returncode == 0, done.stderr
    assert len((place / "fixes.csv").read_text().splitlines()) == 6
    named = trexton(place, "methods", "measurement=mine:Student")
    assert "freedom=4.0 (float" in named.stdout and "degrees of freedom" in named.stdout
    missing = trexton(place, *fly, "--plugin", "nowhere")
    assert missing.returncode == 1 and "'nowhere'" in missing.stderr


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """A map of the hall, for all that only fly it."""
    folder = tmp_path_factory.mktemp("trained")
    write_flight(histogram_flight("hall", frames=80), folder / "hall")
    assert main(["train", str(folder / "hall"), "-o", str(folder / "map.npz"), "--quiet"]) == 0
    return folder / "map.npz"


@pytest.fixture
def fly(place, trained):
    shutil.copy(trained, place)

    def fly(*words):
        return trexton(place, "onboard", "map.npz", "--camera", "hall", "--frames", "5", *words)

    return fly


@pytest.fixture
def here(fly, place, monkeypatch):
    """Commands that are called in this process find the map, the hall and the module."""
    monkeypatch.chdir(place)
    monkeypatch.syspath_prepend(place)
    monkeypatch.delitem(sys.modules, "mine", raising=False)


def test_a_sink_of_ones_own_has_its_address_and_its_options(fly, place, here, capsys):
    done = fly("--output", "mine:Loud:loud.txt", "--loud-word", "here")
    assert done.returncode == 0, done.stderr
    lines = (place / "loud.txt").read_text().splitlines()
    assert len(lines) == 5 and all(line.startswith("here ") for line in lines)
    for address, message in {
        "mine:Nobody:x": "mine has no Nobody",
        "mine:Student:x": "is none of the sinks",
        "theirs:Loud:x": "or module:Class",
        "nothing:x": "is of no known kind",
    }.items():
        assert main(["onboard", "map.npz", "--camera", "hall", "--output", address]) == 1
        said = capsys.readouterr().err
        assert message in said and "Traceback" not in said


def test_a_bug_in_a_sink_ends_the_run_with_its_traceback(fly, place):
    done = fly("--output", "mine:Broken", "--log", "log.jsonl")
    assert done.returncode == 1
    assert "Traceback" in done.stderr and 'fix.position + "metres"' in done.stderr
    assert "trying again" not in done.stderr
    events = [json.loads(line) for line in (place / "log.jsonl").read_text().splitlines()]
    assert events[-1]["event"] == "end" and events[-1]["left_out"] == {
        "broken": 2
    }  # and this event


def test_what_the_world_does_is_tried_again_and_counted(fly, place):
    done = fly("--output", "mine:Unplugged", "--output", "csv:fixes.csv")
    assert "the cable is out: trying again in 1 s" in done.stderr
    assert '"left_out": {"broken": 6}' in done.stderr  # five positions and the end
    assert len((place / "fixes.csv").read_text().splitlines()) == 6


def test_preflight_speaks_to_autopilots_of_ones_own(here, place, monkeypatch, capsys):
    briefly = partial(preflight, seconds=1.0)  # what is not there is waited for in vain
    monkeypatch.setattr("trexton.cli.preflight.preflight", briefly)
    words = ["onboard", "map.npz", "--camera", "hall", "--frames", "5", "--preflight", "--quiet"]
    main([*words, "--output", "mine:Tower:tower.txt", "--output", "mine:Loud:no.txt"])
    said = capsys.readouterr()
    assert "link: loud:tower.txt never answers" in said.out, said.err
    assert (place / "tower.txt").read_text() and not (place / "no.txt").exists()
    assert np.all([line[:4] in ("ok  ", "FAIL") for line in said.out.splitlines()])
