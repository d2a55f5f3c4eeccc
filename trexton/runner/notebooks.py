"""A text notebook as the runner sees it: what it imports, and its hash."""

from __future__ import annotations

import ast
import hashlib
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path

import jupytext

import trexton
from trexton.cache import code_hashes
from trexton.errors import TrextonError

__all__ = ["GIVEN", "Notebook"]

# The runner fills these in; nobody sets them by hand.
GIVEN = ("flight", "test_flight", "out")
# The registry of experiments changes no result: a new line in it must not run everything again.
_NOT_AN_INPUT = ("trexton.experiments", "trexton")


@dataclass(frozen=True)
class Notebook:
    """``<name>.md`` (MyST text notebook) and what can be known of it without running it."""

    path: Path

    @property
    def name(self) -> str:
        return self.path.stem

    @cached_property
    def text(self) -> str:
        return self.path.read_text(encoding="utf-8")

    @property
    def text_hash(self) -> str:
        return hashlib.sha256(self.text.encode()).hexdigest()

    @cached_property
    def content(self):
        """The notebook as nbformat cells."""
        try:
            return jupytext.reads(self.text, fmt="md:myst")
        except Exception as error:  # jupytext raises whatever its parsers do
            raise TrextonError(
                f"{self.path}: not a MyST notebook ({error}): correct its cells"
            ) from None

    @cached_property
    def code(self) -> dict[str, str]:
        """SHA-256 of every module of this package that the notebook's code reaches."""
        source = "\n".join(cell.source for cell in self.content.cells if cell.cell_type == "code")
        hashes: dict[str, str] = {}
        for node in ast.walk(ast.parse(source)):
            for name in _imported_modules(node):
                hashes |= code_hashes(name)
        return {name: hashes[name] for name in sorted(hashes) if name not in _NOT_AN_INPUT}


def _imported_modules(node: ast.AST) -> list[str]:
    """Modules of this package that an import statement loads."""
    names: list[str] = []
    if isinstance(node, ast.Import):
        names = [alias.name for alias in node.names]
    elif isinstance(node, ast.ImportFrom) and node.module:
        lazy = trexton._EXPORTS if node.module == "trexton" else {}
        names = [
            node.module,
            *(lazy.get(alias.name, f"{node.module}.{alias.name}") for alias in node.names),
        ]
    return [name for name in names if name.split(".")[0] == "trexton" and _is_module(name)]


def _is_module(name: str) -> bool:
    try:
        return find_spec(name) is not None
    except ModuleNotFoundError:
        return False
