"""Notebooks as the workflow sees them: what goes into a run of one, and the files it leaves.

Nothing is executed here: the code that a notebook reaches is read from its imports.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from importlib.metadata import entry_points
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from trexton import _EXPORTS
from trexton.base.cache import code_hashes, shipped
from trexton.base.errors import ParameterError
from trexton.base.files import digest, read_text
from trexton.base.plugins import PLUGINS, is_there
from trexton.base.records import software_versions
from trexton.companion.build.engine import Entries, labelled
from trexton.companion.experiments.declaration import Experiment
from trexton.companion.experiments.printed import paper_file
from trexton.companion.experiments.registry import MODULES
from trexton.companion.provenance import kept_results

# The workflow fills these in; nobody sets them by hand.
GIVEN = ("flight", "test_flight", "out")
_IMPORT = re.compile(r"\b(trexton(?:\.\w+)*)(?: import (\([^)]*\)|[^;\n]+))?")
# The registry of experiments changes no result: a new line in it must not run everything again.
_NOT_AN_INPUT = ("trexton.companion.experiments.registry", "trexton")


def find_notebooks(
    folder: str | os.PathLike[str] | None, experiments: Mapping[str, Experiment]
) -> dict[str, Notebook]:
    """The notebook of each experiment, in the order of the registry.

    It is ``<name>.md`` of the folder (this package's own by default). That of a person's own
    experiment may stand beside its module instead.

    Raises `ParameterError` where the folder has none.
    """
    place = shipped("notebooks") if folder is None else Path(folder)
    if folder and not any((place / f"{name}.md").is_file() for name in experiments):
        raise ParameterError(
            f"{place}: holds no notebook of an experiment: expected files such as "
            f"{next(iter(experiments))}.md"
        )
    notebooks = {}
    for name in experiments:
        path = place / f"{name}.md"
        if not path.is_file() and name not in MODULES:
            module = find_spec(experiments[name].module)
            path = Path(str(module and module.origin)).with_suffix(".md")
        if path.is_file():
            own = own_code(name, experiments)
            notebooks[name] = Notebook(name, str(path), read_text(path), own)
    return notebooks


@dataclass(frozen=True)
class Notebook:
    """A MyST text notebook, what it says without running it, and code of plugins it may use."""

    name: str
    source: str
    text: str
    plugged: Mapping[str, str] = field(default_factory=dict)

    def inputs(self, parameters: Mapping[str, object], data: Mapping[str, str]) -> Entries:
        """Everything that goes into a run but the records of other experiments, in words."""
        printed = sorted(paper_file("").glob("*.toml"))
        return {
            "the notebook's text": digest(self.text),
            **inputs_of(parameters, self.code, data),
            **labelled("file", {f"data/paper/{p.name}": digest(p) for p in printed}),
            **labelled("file", {f"data/reference/{k}": v for k, v in self.kept.items()}),
        }

    @cached_property
    def code(self) -> dict[str, str]:
        """SHA-256 of every module that the notebook or plugins name or reach, and of plugins."""
        hashes = {file: digest(text) for file, text in self.plugged.items()}
        for module, words in _IMPORT.findall("\n".join([self.text, *self.plugged.values()])):
            names = re.findall(r"\w+", words)
            lazy = [_EXPORTS.get(name, "") for name in names] if module == "trexton" else []
            for name in (module, *lazy, *(f"{module}.{name}" for name in names)):
                hashes |= code_hashes(name)
        return {name: hashes[name] for name in sorted(hashes) if name not in _NOT_AN_INPUT}

    @property
    def kept(self) -> dict[str, str]:
        """SHA-256 of every result of a longer run, kept with the code, that its code names."""
        words = re.findall(r"""["']([\w-]+)["']""", self.text)
        kept = {path: path.stem.removeprefix("sweep-") for path in kept_results()}
        return {path.name: digest(path) for path, name in kept.items() if name in words}


@cache
def _registered() -> list[str]:
    found = entry_points()
    groups = {each for each in found.groups if each.startswith("trexton.")} - {"trexton.commands"}
    return [one.module for each in groups for one in found.select(group=each)]


def own_code(name: str, experiments: Mapping[str, Experiment]) -> dict[str, str]:
    """By file the Python code of a person's own that an experiment could use: of all plugins, but
    those that declare another, their packages, or the files beside them.
    """
    modules = {*os.environ.get(PLUGINS, "").split(","), *_registered()} - {""}
    others = {key for key in experiments if key not in (name, *MODULES)} if modules else ()
    if others and not experiments[name].every_flight:
        modules -= {experiments[key].module for key in others}
    found: list[Path] = []
    for top in {each.partition(".")[0] for each in modules if is_there(each)}:
        spec = find_spec(top)
        packages = (spec and spec.submodule_search_locations) or ()
        inside = [path for each in packages for path in Path(each).rglob("*.py")]
        found += inside or [*Path(str(spec and spec.origin)).parent.glob("*.py")]
    return {str(path): path.read_text("utf-8", "replace") for path in dict.fromkeys(found)}


def inputs_of(
    parameters: Mapping[str, object], code: Mapping[str, str], data: Mapping[str, str]
) -> Entries:
    """What goes into any run: parameters, hashes of modules and of flights (by role), versions."""
    return {
        **labelled("parameter", {name: repr(value) for name, value in parameters.items()}),
        **labelled("module", code),
        **labelled("data of the flight", data),
        **labelled("version of", software_versions()),
    }


def outputs_of(folder: Path, name: str) -> list[Path]:
    """What the experiment `name` left in `folder`: record, executed notebook, figures, pictures."""
    kept = [path for path in (folder / f"{name}.json", folder / f"{name}.ipynb") if path.is_file()]
    return kept + sorted(path for path in folder.glob(f"{name}-*") if path.is_file())


def read_content(path: Path) -> Any:
    """The content of a JSON file; None where it is missing or damaged."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
