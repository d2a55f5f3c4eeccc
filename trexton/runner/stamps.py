"""Why an experiment may be reused or must run.

A stamp keeps everything that went into an experiment and the hash of all it left. It is the last thing
written, so a run that was cut short has none and is run again.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from pathlib import Path

from trexton.files import atomic_file, canonical_json, digest
from trexton.paper import paper_file
from trexton.records import software_versions
from trexton.runner.notebooks import Notebook

__all__ = ["Stamp", "differences", "gather_inputs", "outputs_of"]

SCHEMA = 1
# What a person reads instead of the key of an entry.
_LABELS = {
    "code": "module",
    "data": "data of the flight",
    "records": "record",
    "versions": "version of",
    "paper": "file data/paper/",
}


def gather_inputs(
    notebook: Notebook,
    parameters: dict,
    data: dict[str, str],
    records: Iterable[Path],
    timings: bool,
) -> dict:
    """Everything that goes into a run, as JSON values.

    Parameters
    ----------
    data : dict
        Hash of each flight by name.
    records : paths
        Records of other experiments that this one reads; their timings count only if `timings`.
    """
    paper = sorted(paper_file("").glob("*.toml"))
    return {
        "notebook": notebook.text_hash,
        "parameters": parameters,
        "data": data,
        "code": notebook.code,
        "versions": software_versions(),
        "paper": {path.name: digest(path) for path in paper},
        "records": {
            f"{path.parent.name}/{path.stem}": _record_hash(path, timings) for path in records
        },
    }


def _record_hash(path: Path, timings: bool) -> str:
    content = json.loads(path.read_text(encoding="utf-8"))
    return digest(
        content if timings else {key: value for key, value in content.items() if key != "timings"}
    )


def outputs_of(folder: Path, name: str) -> list[Path]:
    """What the experiment `name` left in `folder`: record, executed notebook, figures and pictures."""
    kept = [path for path in (folder / f"{name}.json", folder / f"{name}.ipynb") if path.is_file()]
    return kept + sorted(path for path in folder.glob(f"{name}-*") if path.is_file())


class Stamp:
    """The stamp of one experiment of one folder of results: ``<out>/.stamps/<folder>/<name>.json``."""

    def __init__(self, out: Path, folder: Path, name: str):
        self.folder, self.name = folder, name
        self.path = out / ".stamps" / (folder.name if folder != out else "_all") / f"{name}.json"

    def clear(self) -> None:
        """Forget the last run and remove what it left, the stamp first."""
        self.path.unlink(missing_ok=True)
        cut_short = self.folder.glob(f".{self.name}.*.ipynb")
        for path in [*outputs_of(self.folder, self.name), self.failed_notebook, *cut_short]:
            path.unlink(missing_ok=True)

    @property
    def failed_notebook(self) -> Path:
        """Where the partial output of a failing run is kept."""
        return self.folder / f"{self.name}.failed.ipynb"

    def write(self, inputs: dict, seconds: float) -> None:
        """Seal a finished run."""
        outputs = {path.name: digest(path) for path in outputs_of(self.folder, self.name)}
        with atomic_file(self.path) as stream:
            stream.write(
                canonical_json(
                    {
                        "schema": SCHEMA,
                        "inputs": inputs,
                        "outputs": outputs,
                        "seconds": round(seconds, 2),
                    }
                )
            )

    def reasons(self, inputs: dict) -> list[str]:
        """Why the last run cannot be reused for `inputs`; empty if it can."""
        try:
            stamp = json.loads(self.path.read_text(encoding="utf-8"))
            old, outputs, schema = stamp["inputs"], stamp["outputs"], stamp["schema"]
        except OSError:
            return ["no finished run"]
        except (ValueError, KeyError, TypeError):
            return ["the stamp of the last run is damaged"]
        if schema != SCHEMA:
            return ["the last run was made by another version of the runner"]
        reasons = differences(old, inputs)
        for name, expected in outputs.items():
            path = self.folder / name
            if not path.is_file():
                reasons.append(f"{name} is missing")
            elif digest(path) != expected:
                reasons.append(f"{name} is not what the run left")
        return reasons


def differences(old: dict, new: dict) -> list[str]:
    """What changed between two sets of inputs, in words."""
    reasons = ["the notebook's text changed"] if old.get("notebook") != new["notebook"] else []
    for group in ("parameters", "data", "code", "versions", "paper", "records"):
        before, after = old.get(group, {}), new[group]
        for key in sorted(before.keys() | after.keys()):
            if before.get(key, ...) != after.get(key, ...):
                reasons.append(_difference(group, key, before, after))
    return reasons


def _difference(group: str, key: str, before: dict, after: dict) -> str:
    if group == "parameters":
        old, new = (repr(table[key]) if key in table else "absent" for table in (before, after))
        return f"parameter {key} {old} -> {new}"
    label = f"{_LABELS[group]}{'' if group == 'paper' else ' '}{key}"
    if group == "versions":
        return f"{label} {before.get(key, 'absent')} -> {after.get(key, 'absent')}"
    return (
        f"{label} {'is new' if key not in before else 'is gone' if key not in after else 'changed'}"
    )
