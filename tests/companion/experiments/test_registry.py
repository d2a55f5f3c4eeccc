"""The experiments by name: this package's declare themselves, a person's own join them."""

from __future__ import annotations

import subprocess
import sys

import pytest

from trexton.base.plugins import PLUGINS
from trexton.companion.build.notebooks import find_notebooks
from trexton.companion.claims.ledger import load_claims
from trexton.companion.experiments.declaration import NEEDS
from trexton.companion.experiments.registry import EXPERIMENTS, LEDGER

OWN = '''"""An experiment of one's own."""
from dataclasses import dataclass
from trexton.companion.experiments.declaration import Experiment, SeedParameters

CLAIM = {
    "id": "still", "place": "here", "text": "It stands", "measure": "m", "kind": "below",
    "bound": 0.2, "ours": "own_study:median",
}

@dataclass(frozen=True)
class Parameters(SeedParameters):
    """What can be chosen."""

def run(train, test, parameters):
    return parameters.record(train, values={"median": 0.1})

EXPERIMENT = Experiment("My own", Parameters, run, claims=(CLAIM,))
'''


def test_every_experiment_declares_itself():
    for name, experiment in EXPERIMENTS.items():
        assert set(experiment.needs) <= NEEDS.keys() and experiment.title
        if name != LEDGER:
            assert experiment.module == f"trexton.companion.experiments.{name}"
            assert experiment.run is not None and experiment.finding is not None
    assert EXPERIMENTS[LEDGER].every_flight and list(EXPERIMENTS)[-1] == LEDGER
    assert "none" not in EXPERIMENTS
    with pytest.raises(KeyError):
        EXPERIMENTS["none"]


def test_whether_there_is_an_experiment_is_known_without_its_module():
    asked = "'rooms' in EXPERIMENTS and 'none' not in EXPERIMENTS"
    loaded = "any(name.startswith('trexton.companion.experiments.rooms') for name in sys.modules)"
    lines = "import sys; from trexton.companion.experiments.registry import EXPERIMENTS"
    done = subprocess.run(
        [sys.executable, "-c", f"{lines}; print({asked}, {loaded})"], capture_output=True
    )
    assert done.stdout.split() == [b"True", b"False"], done.stderr


def test_an_experiment_of_ones_own_joins_with_its_notebook_and_its_claims(tmp_path, monkeypatch):
    (tmp_path / "own_study.py").write_text(OWN)
    (tmp_path / "own_study.md").write_text("# My own\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv(PLUGINS, "own_study")
    assert EXPERIMENTS["own_study"].title == "My own"
    assert find_notebooks(None, EXPERIMENTS)["own_study"].text == "# My own\n"
    assert "still" in {claim.id for claim in load_claims()}
