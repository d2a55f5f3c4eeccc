"""What goes into an experiment and comes out of it: nodes that the engine compares by content."""

from __future__ import annotations

import hashlib
import json
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from trexton.base.files import digest
from trexton.base.records import software_versions
from trexton.companion.build.notebooks import Notebook
from trexton.companion.experiments.printed import paper_file

__all__ = [
    "HashedNode",
    "fixed",
    "inputs_of",
    "outputs_of",
    "reading",
    "reasons",
    "record_fact",
    "remembered",
]

Entries = dict[str, str]
_LABELS = {
    "data": "data of the flight ",
    "code": "module ",
    "paper": "file data/paper/",
    "reference": "file data/reference/",
    "record": "record ",
}


@dataclass
class HashedNode:
    """A node of the engine: named entries whose values are compared, among them hashes of files.

    Attributes
    ----------
    owner : str
        The task to which the fact belongs; empty for what one task leaves and another reads.
    read : callable
        The entries now; None where there is nothing yet.
    """

    name: str
    owner: str
    read: Callable[[], Entries | None]
    attributes: dict[Any, Any] = field(default_factory=dict)

    @property
    def signature(self) -> str:
        """Names the node among all others."""
        return hashlib.sha256(f"{self.owner}\n{self.name}".encode()).hexdigest()

    def state(self) -> str | None:
        """The entries as one text, which the engine keeps and compares."""
        entries = self.read()
        return None if entries is None else json.dumps(entries, sort_keys=True)

    def load(self, is_product: bool = False) -> None:
        """Nothing is handed to the task: it reads the files itself."""

    def save(self, value: object) -> None:
        """Nothing is kept: the task writes the files itself."""


def fixed(name: str, owner: str, entries: Mapping[str, object]) -> HashedNode:
    """What is fixed beforehand; values that are no text are compared by their `repr`."""
    texts = {
        key: value if isinstance(value, str) else repr(value) for key, value in entries.items()
    }
    return HashedNode(name, owner, lambda: texts)


def inputs_of(
    owner: str, notebook: Notebook, parameters: Mapping[str, object], data: Mapping[str, str]
) -> list[HashedNode]:
    """Everything that goes into a run but the records of other experiments."""
    paper = sorted(paper_file("").glob("*.toml"))
    return [
        fixed("notebook", owner, {"text": notebook.text_hash}),
        fixed("parameters", owner, {key: repr(value) for key, value in parameters.items()}),
        fixed("data", owner, data),
        fixed("code", owner, notebook.code),
        fixed("versions", owner, software_versions()),
        fixed("paper", owner, {path.name: digest(path) for path in paper}),
        fixed("reference", owner, notebook.kept),
    ]


def reading(owner: str, records: Sequence[Path]) -> HashedNode:
    """Which records are read: a record that is gone changes a result too."""
    return fixed("record", owner, {_label(path): "read" for path in records})


def _label(path: Path) -> str:
    return f"{path.parent.name}/{path.stem}"


def record_fact(path: Path, owner: str = "", timings: bool = False) -> HashedNode:
    """The record at `path`; its timings count only if `timings`."""
    label = _label(path)

    def read() -> Entries | None:
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
        except (OSError, ValueError):
            return None
        return {label: digest({k: v for k, v in content.items() if timings or k != "timings"})}

    return HashedNode(f"record {label}", owner, read)


def outputs_fact(owner: str, folder: Path, name: str) -> HashedNode:
    """All files that the experiment left; None without its record."""

    def read() -> Entries | None:
        files = {path.name: digest(path) for path in outputs_of(folder, name)}
        return files if f"{name}.json" in files else None

    return HashedNode("outputs", owner, read)


def outputs_of(folder: Path, name: str) -> list[Path]:
    """What the experiment `name` left in `folder`: record, executed notebook, figures, pictures."""
    kept = [path for path in (folder / f"{name}.json", folder / f"{name}.ipynb") if path.is_file()]
    return kept + sorted(path for path in folder.glob(f"{name}-*") if path.is_file())


def remembered(root: Path) -> dict[str, dict[str, str]]:
    """What the engine's lock file (and the journal of a run cut short) holds, by task and fact.

    A file that cannot be read is put away: everything is then run again, which is always right.
    """
    lock, journal = root / "pytask.lock", root / "pytask.lock.journal"
    try:
        entries = tomllib.loads(lock.read_text("utf-8"))["task"] if lock.is_file() else []
        if lock.is_file() and tomllib.loads(lock.read_text("utf-8"))["lock-version"] != "1":
            raise ValueError("another version")
    except (ValueError, KeyError, TypeError):
        lock.replace(lock.with_suffix(".damaged"))
        entries = []
    if journal.is_file():
        for line in journal.read_text("utf-8", errors="replace").splitlines():
            try:
                entries.append(json.loads(line))
            except ValueError:
                break  # the line that was being written when the run was killed
    return {one["id"]: one.get("depends_on", {}) | one.get("produces", {}) for one in entries}


def reasons(
    facts: list[HashedNode], before: Mapping[str, str] | None, folder: Path, name: str
) -> list[str]:
    """Why the last run cannot be reused, in words."""
    if before is None:
        return ["no finished run"]
    lines = []
    for fact in facts:
        old, new = json.loads(before.get(fact.name, "{}")), fact.read() or {}
        if fact.name == "outputs":
            lines += _touched(old, folder)
            continue
        for key in sorted(old.keys() | new.keys()):
            if old.get(key) != new.get(key):
                lines.append(_difference(fact.name.split()[0], key, old.get(key), new.get(key)))
    return list(dict.fromkeys(lines))


def _touched(old: Entries, folder: Path) -> list[str]:
    """Outputs that are no longer what the run left."""
    lines = []
    for name, expected in old.items():
        if not (folder / name).is_file():
            lines.append(f"{name} is missing")
        elif digest(folder / name) != expected:
            lines.append(f"{name} is not what the run left")
    return lines


def _difference(group: str, key: str, old: str | None, new: str | None) -> str:
    if group == "notebook":
        return "the notebook's text changed"
    if group in ("parameters", "versions"):
        label = "parameter" if group == "parameters" else "version of"
        return f"{label} {key} {old or 'absent'} -> {new or 'absent'}"
    changed = "is new" if old is None else "is gone" if new is None else "changed"
    return f"{_LABELS[group]}{key} {changed}"
