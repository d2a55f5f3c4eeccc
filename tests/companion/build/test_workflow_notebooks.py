"""A notebook without running it: the code it reaches; what changed between two runs, in words."""

from __future__ import annotations

import importlib
import json
import sys

import pytest
from conftest import ROOT
from tiny_notebooks import write_notebook

from trexton.base.errors import TrextonError
from trexton.base.plugins import PLUGINS
from trexton.companion.build import notebooks
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


@pytest.fixture
def plugged(tmp_path, monkeypatch):
    """Where packages of a person's own lie; a way to write there; inputs of two notebooks."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(notebooks, "_registered", notebooks._registered.__wrapped__)

    def write(**sources):
        for name, source in sources.items():
            path = tmp_path / f"{name.replace('__', '/')}.py"
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(source)
        importlib.invalidate_caches()

    def inputs(*names):
        found = find_notebooks(None, EXPERIMENTS)
        return [found[name].inputs({}, {}) for name in names]

    def forget():  # or the place of another test's module would be known
        for name in [each for each in sys.modules if each.startswith(("own_study", "walks"))]:
            del sys.modules[name]

    forget()
    yield tmp_path, write, inputs
    forget()


def test_the_code_of_a_plugin_goes_into_what_could_use_it(plugged, monkeypatch):
    folder, write, inputs = plugged
    without = inputs("fine", "claims")
    write(walks__way="from walks.core import steps", walks__core__steps="STEP = 1")
    write(walks__hall="import trexton.simulator.hall", unused="")
    assert inputs("fine", "claims") == without, "nobody has named it"
    monkeypatch.setenv(PLUGINS, "walks.way")
    [first, ledger] = inputs("fine", "claims")
    files = {f"module {folder / name}" for name in ("walks/way.py", "walks/core/steps.py")}
    assert first.keys() >= files | {"module trexton.simulator.hall"}
    assert f"module {folder / 'unused.py'}" not in first
    assert inputs("fine", "claims") == [first, ledger]
    write(walks__core__steps="STEP = 2")
    for before, now in zip([first, ledger], inputs("fine", "claims"), strict=True):
        [said] = reasons(before, now)
        assert said.startswith(f"module {folder / 'walks/core/steps.py'} ")
    monkeypatch.delenv(PLUGINS)
    assert inputs("fine", "claims") == without


def test_an_experiment_of_ones_own_goes_into_its_page_and_the_ledger(plugged, monkeypatch):
    folder, write, inputs = plugged
    source = (ROOT / "tests" / "tiny_experiment.py").read_text()
    write(own_study=source + "EXPERIMENT = tiny('My own')\n", beside="STEP = 1")
    (folder / "own_study.md").write_text("# My own\n")
    monkeypatch.setenv(PLUGINS, "own_study")
    before = inputs("own_study", "fine", "claims")
    write(own_study=source + "EXPERIMENT = tiny('Another')\n", beside="STEP = 2")
    own, fine, ledger = map(reasons, before, inputs("own_study", "fine", "claims"))
    assert fine == [] and own == ledger
    assert [f"module {folder / name}.py" for name in ("beside", "own_study")] == sorted(
        said.partition(" ")[0] + " " + said.split(" ")[1] for said in own
    )


def test_a_part_that_an_installed_package_registers_counts(plugged):
    folder, write, inputs = plugged
    write(walks="STEP = 1")
    about = folder / "walks-1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Name: walks\nVersion: 1\n")
    (about / "entry_points.txt").write_text("[trexton.motion]\nown = walks:Walk\n")
    [before] = inputs("fine")
    write(walks="STEP = 2")
    [said] = reasons(before, *inputs("fine"))
    assert said.startswith(f"module {folder / 'walks.py'} ")


def read(path):
    return Notebook(path.stem, str(path), path.read_text())
