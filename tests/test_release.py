"""A release: one version everywhere, what the checklists name is there, old files are read."""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tomllib
from fnmatch import fnmatch
from pathlib import Path

import numpy as np
import pytest
import yaml
from conftest import ROOT

from trexton import __version__
from trexton.base.records import Record
from trexton.companion.experiments.registry import EXPERIMENTS
from trexton.flights.folder import read_flight
from trexton.localization.localizer import Localizer
from trexton.localization.map_files import load_map, save_map

KEPT = Path(__file__).parent / "formats" / "0.1"


def test_one_version_everywhere():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert yaml.safe_load((ROOT / "CITATION.cff").read_text())["version"] == version
    for name in ("codemeta.json", ".zenodo.json"):
        assert json.loads((ROOT / name).read_text())["version"] == version
    assert version == __version__
    assert f"\n## {version}\n" in (ROOT / "CHANGELOG.md").read_text()


def test_a_release_of_the_changelog_has_fifteen_lines_at_most():
    releases = re.split(r"\n## ", (ROOT / "CHANGELOG.md").read_text())[1:]
    assert releases and all(len(re.findall(r"^- ", text, re.MULTILINE)) <= 15 for text in releases)


def test_the_evidence_of_the_quality_declaration_is_there():
    text = (ROOT / "QUALITY.md").read_text()
    targets = re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.M)
    named = re.findall(r"`([^`]+)`", text)
    assert len(named) > 15
    for each in named:
        verb = each.removeprefix("make ")
        assert verb in targets if verb != each else (ROOT / each).exists(), each


def test_what_the_checklists_link_to_is_there():
    links = re.findall(r"\]\(([^):]+)\)", (ROOT / "PUBLISHING.md").read_text())
    assert len(links) > 15 and [name for name in links if not (ROOT / name).exists()] == []


def test_every_promise_names_a_test_that_is_there():
    text = (ROOT / "book" / "trust.md").read_text().partition("## Promised")[2]
    lines = text.partition("\n## ")[0].splitlines()
    rows = [line for line in lines if line.startswith("| ")][1:]
    named = [re.findall(r"`(test_\w+)`", row) for row in rows]
    files = (path.read_text() for path in (ROOT / "tests").rglob("test_*.py"))
    there = {name for file in files for name in re.findall(r"def (test_\w+)\(", file)}
    assert len(rows) >= 14 and all(named)
    promised = (ROOT / "SECURITY.md").read_text().partition("**What is not.**")[0]
    named += [names := re.findall(r"`(test_\w+)`", promised)]
    assert len(names) >= 6
    assert {name for names in named for name in names} <= there


def test_the_manifest_names_what_experiments_leave():
    manifest = yaml.safe_load((ROOT / "codecheck.yml").read_text())["manifest"]
    lacks = {"sim-survey": {"histograms"}, "cyberzoo": {"images", "floor", "camera"}}
    left = {
        f"results/{flight}/{name}.json"
        for flight, lacking in lacks.items()
        for name, experiment in EXPERIMENTS.items()
        if experiment.run and not lacking & set(experiment.needs)
    }
    assert sorted(entry["file"] for entry in manifest) == sorted({*left, "results/claims.json"})


def test_a_flight_and_a_record_of_0_1_are_read():
    flight = read_flight(KEPT / "flight")
    assert len(flight) == 40 and flight.split == {"train": (0, 29), "test": (30, 39)}
    np.testing.assert_allclose(flight.position[0], [1.8, 1.0])
    record = Record.load(KEPT / "kept.json")
    assert record.values == {"filter": {"mean_cm": {"value": 45.5, "low": 40.0, "high": 51.0}}}
    assert record.images["p"].ravel().tolist() == list(range(48))


def test_a_map_of_0_1_is_read_flown_and_written_again(tmp_path):
    texton_map, flight = load_map(KEPT / "paper.npz"), read_flight(KEPT / "flight")
    np.testing.assert_allclose(texton_map.positions, flight.position[:30])
    again = load_map(save_map(texton_map, tmp_path / "again.npz"))
    assert again.method == "paper" and again.neighbors == texton_map.neighbors
    localizer = Localizer(again, rng=np.random.default_rng(1))
    for row in range(30, 40):
        estimate = localizer.step(flight.histograms[row])
    assert np.isfinite(estimate.position).all() and np.isfinite(estimate.covariance).all()


def test_a_crate_of_results_is_whole(tmp_path):
    pytest.importorskip("rocrate")
    words = [sys.executable, Path(__file__).parent / "crate.py", "--results", KEPT]
    words += ["--book", tmp_path / "none", "--out", tmp_path / "crate.zip"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 0 and done.stdout.endswith("whole\n"), done.stdout + done.stderr
    import crate

    assert crate.faults(tmp_path / "crate.zip") == []


def test_no_test_is_passed_over(pytestconfig):
    """By default pytest does not enter a folder called `build`, and a room is called so."""
    left_out = pytestconfig.getini("norecursedirs")
    for path in (ROOT / "tests").rglob("test_*.py"):
        folders = path.relative_to(ROOT).parts[:-1]
        assert not any(fnmatch(name, each) for name in folders for each in left_out), path
