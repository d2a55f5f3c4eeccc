"""A notebook without running it: the code it reaches; what changed between two runs, in words."""

from __future__ import annotations

import json

import pytest
from conftest import ROOT
from tiny_notebooks import write_notebook

from trexton.base.errors import TrextonError
from trexton.companion.build.engine import Fact, Step, _reasons
from trexton.companion.build.notebooks import Notebook, find_notebooks
from trexton.companion.experiments.registry import EXPERIMENTS


def test_code_behind_a_notebook_is_found_however_deep(tmp_path):
    body = (
        "from trexton import Localizer\nfrom trexton.companion.experiments import mocap_training\n"
    )
    code = read(write_notebook(tmp_path, "deep", body)).code
    assert {
        "trexton.localization.localizer",
        "trexton.localization.filters",
        "trexton.companion.experiments.mocap_training",
        "trexton.base.files",
    } <= code.keys()
    assert (
        "trexton.companion.experiments.registry" not in code
    )  # the registry: a new line in it changes no result


def test_every_way_to_import_is_understood(tmp_path):
    body = (
        "%matplotlib inline\n!true\nif True:\n"
        "    from trexton.evaluation import (\n  held_out,\n)\n"
    )
    assert "trexton.evaluation.held_out" in read(write_notebook(tmp_path, "lines", body)).code
    for body in ("import trexton.evaluation.held_out as m",
                 "import os, trexton.evaluation.held_out",
                 "import os; from trexton.evaluation import held_out; import json"):  # fmt: skip
        code = read(write_notebook(tmp_path, "named", body)).code
        assert "trexton.evaluation.held_out" in code


def test_a_notebook_that_is_no_text_is_named(tmp_path):
    (tmp_path / "timing.md").write_bytes("grün".encode("latin-1"))
    with pytest.raises(TrextonError, match="timing.md: not a text file .*: write it as UTF-8"):
        find_notebooks(tmp_path, EXPERIMENTS)


def test_a_result_kept_with_the_code_that_a_notebook_shows_goes_into_it():
    notebooks = find_notebooks(None, EXPERIMENTS)
    assert notebooks["density"].kept.keys() == {"density.json"}
    assert notebooks["suitability"].kept.keys() == {"sweep-suitability.json"}
    assert not notebooks["mocap_training"].kept
    assert Notebook("own", "own.md", "reference('density')").kept.keys() == {"density.json"}
    inputs = notebooks["fine"].inputs({}, {})
    assert "file data/reference/fine.json" in inputs
    before = inputs | {"file data/reference/fine.json": "1"}
    assert reasons(before, inputs) == [
        f"file data/reference/fine.json 1 -> {inputs['file data/reference/fine.json'][:12]}"
    ]


def reasons(before, now, outputs=None, left=None):
    """Why a step with these inputs and outputs is run again."""
    step = Step("task", now, print, [Fact("outputs", lambda: left)])
    kept = {"task: inputs": json.dumps(before), "outputs": json.dumps(outputs or {})}
    return _reasons(step, kept)


def test_changes_are_told_in_words():
    old = {
        "parameter n": "1", "parameter gone": "2", "module trexton.x": "1", "module trexton.y": "1",
        "data of the flight train": "1", "version of numpy": "2.0", "the notebook's text": "a",
        "record small/first": "1",
    }  # fmt: skip
    new = {
        "parameter n": "2", "module trexton.x": "2", "module trexton.z": "1",
        "data of the flight train": "1", "data of the flight test": "2", "version of numpy": "2.1",
        "file data/paper/claims.toml": "1", "the notebook's text": "b", "record small/first": "2",
    }  # fmt: skip
    assert reasons(old, new) == [
        "data of the flight test absent -> 2",
        "file data/paper/claims.toml absent -> 1",
        "module trexton.x 1 -> 2",
        "module trexton.y 1 -> absent",
        "module trexton.z absent -> 1",
        "parameter gone 2 -> absent",
        "parameter n 1 -> 2",
        "record small/first 1 -> 2",
        "the notebook's text a -> b",
        "version of numpy 2.0 -> 2.1",
    ]
    left = {"a.json": "1", "b.svg": "2"}
    assert reasons({}, {}, left, {"b.svg": "3"}) == ["a.json 1 -> absent", "b.svg 2 -> 3"]


def test_every_registered_experiment_has_a_notebook_and_every_dependency_exists():
    notebooks = find_notebooks(None, EXPERIMENTS)
    assert notebooks.keys() == EXPERIMENTS.keys()
    for name, experiment in EXPERIMENTS.items():
        assert set(experiment.after) <= EXPERIMENTS.keys()
        assert notebooks[name].code
        assert experiment.every_flight or "given.parameters" in notebooks[name].text
        assert experiment.parameters().as_dict() == experiment.parameters.parse({}).as_dict()
    assert {path.stem for path in (ROOT / "notebooks").glob("*.md")} <= EXPERIMENTS.keys()


def read(path):
    return Notebook(path.stem, str(path), path.read_text())
