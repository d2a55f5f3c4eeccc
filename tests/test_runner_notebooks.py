"""A notebook without running it: its parameters, the code it reaches; and what changed between two runs, in words."""

from __future__ import annotations

from conftest import ROOT
from tiny_notebooks import write_notebook

from trexton.experiments import EXPERIMENTS
from trexton.runner.notebooks import Notebook
from trexton.runner.stamps import differences


def test_code_behind_a_notebook_is_found_however_deep(tmp_path):
    body = "from trexton import TextonMap\nfrom trexton.experiments import mocap_training\nimport numpy"
    code = Notebook(write_notebook(tmp_path, "deep", body)).code
    assert {
        "trexton.localizer",
        "trexton.parts.filters",
        "trexton.experiments.mocap_training",
        "trexton.files",
    } <= code.keys()
    assert "trexton.experiments" not in code  # the registry: a new line in it changes no result


def test_changes_are_told_in_words():
    same = {
        "notebook": "a",
        "data": {"train": "1"},
        "versions": {"numpy": "2.0"},
        "paper": {},
        "records": {},
    }
    old = same | {"parameters": {"n": 1, "gone": 2}, "code": {"trexton.x": "1", "trexton.y": "1"}}
    new = same | {"parameters": {"n": 2}, "code": {"trexton.x": "2", "trexton.z": "1"}}
    new |= {
        "data": {"train": "1", "test": "2"},
        "versions": {"numpy": "2.1"},
        "paper": {"claims.toml": "1"},
    }
    assert differences(old, new) == [
        "parameter gone 2 -> absent",
        "parameter n 1 -> 2",
        "data of the flight test is new",
        "module trexton.x changed",
        "module trexton.y is gone",
        "module trexton.z is new",
        "version of numpy 2.0 -> 2.1",
        "file data/paper/claims.toml is new",
    ]


def test_every_registered_notebook_can_be_read_and_every_dependency_exists():
    folder = ROOT / "notebooks"
    for name, experiment in EXPERIMENTS.items():
        assert set(experiment.after) <= EXPERIMENTS.keys()
        if (path := folder / f"{name}.md").exists():
            notebook = Notebook(path)
            assert notebook.code
            assert experiment.every_flight or f"{name}.Parameters" in notebook.text
            assert experiment.parameters(name)() == experiment.parameters(name).parse({})
    assert {path.stem for path in folder.glob("*.md")} <= EXPERIMENTS.keys()
