"""An experiment of one file and one line: notebook, picture and claim are made from it."""

from __future__ import annotations

import json
import os

import pytest
from conftest import ROOT, small_flight

from trexton.companion.build.formats import nbformat
from trexton.companion.build.notebooks import find_notebooks
from trexton.companion.build.workflow import FlightPair, run_experiments
from trexton.companion.claims.api import load_claims
from trexton.companion.experiments.registry import EXPERIMENTS, Experiment
from trexton.flights import write_flight


@pytest.fixture
def line(monkeypatch):
    """The one line of the registry."""
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}{os.pathsep}{ROOT / 'tests'}")
    experiment = Experiment("How fast it flew", module="tiny_study", needs=("positions",))
    monkeypatch.setitem(EXPERIMENTS, "tiny_study", experiment)
    return {"tiny_study": experiment}


def test_record_picture_and_page_come_from_the_module(line, tmp_path):
    flight = write_flight(small_flight(), tmp_path / "room")
    (outcome,) = run_experiments(
        [FlightPair(str(flight))], tmp_path / "out", experiments=line, settings={"percentile": 50}
    )
    assert outcome.status == "ran", outcome.reasons
    folder = tmp_path / "out" / "small"
    left = {path.name for path in folder.iterdir()}
    assert left >= {"tiny_study-speed.svg", "tiny_study.ipynb", "tiny_study.json"}
    record = json.loads((folder / "tiny_study.json").read_text())
    assert record["parameters"] == {"seed": 1, "percentile": 50.0}
    assert record["values"]["top_m_s"] == record["values"]["median_m_s"] > 0
    page = nbformat.read(folder / "tiny_study.ipynb", as_version=4)
    text = "\n".join(cell.source for cell in page.cells if cell.cell_type == "markdown")
    assert text.startswith("# How fast it flew") and "From positions alone" in text
    pictures = [cell for cell in page.cells if "mystnb" in cell.metadata]
    assert [cell.metadata["mystnb"]["image"]["alt"] for cell in pictures] == [
        "Speed of the vehicle in every frame."
    ]


def test_its_claims_stand_in_the_ledger(line, monkeypatch):
    with_claims = Experiment("How fast it flew", module="tiny_study", claims=True)
    monkeypatch.setitem(EXPERIMENTS, "tiny_study", with_claims)
    (mine,) = [claim for claim in load_claims() if claim.experiment == "tiny_study"]
    assert (mine.id, mine.threshold) == ("top-speed", 3.0)
    assert "page.claims()" in find_notebooks(None, {"tiny_study": with_claims})["tiny_study"].text
