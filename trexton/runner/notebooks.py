"""A text notebook as the runner sees it: its parameters, what it imports, and its hash."""

from __future__ import annotations

import ast
import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path

import jupytext

import trexton
from trexton.cache import code_hashes
from trexton.errors import ParameterError, TrextonError

__all__ = ["GIVEN", "Notebook", "Parameter"]

# The runner fills these in where a notebook's parameters cell names them; nobody sets them by hand.
GIVEN = ("flight", "test_flight", "out")
# The registry of experiments changes no result: a new line in it must not run everything again.
_NOT_AN_INPUT = ("trexton.experiments", "trexton")
_WORDS = {"true": True, "false": False, "none": None}


@dataclass(frozen=True)
class Parameter:
    """One assignment of the parameters cell: a default, and the names of the types it may have."""

    name: str
    default: object
    types: tuple[str, ...]

    def parse(self, text: str) -> object:
        """The value that `text` (as typed after ``--set name=``) stands for.

        Raises
        ------
        ParameterError
            It is of another type than the default.
        """
        if self.types == ("str",):
            return text
        try:
            value = _WORDS[text.lower()] if text.lower() in _WORDS else ast.literal_eval(text)
        except (ValueError, SyntaxError):
            value = text
        return self.check(value)

    def check(self, value: object) -> object:
        """`value` if its type fits (an int also stands for a float); raises `ParameterError` otherwise."""
        kind = "None" if value is None else type(value).__name__
        if kind == "int" and "float" in self.types and "int" not in self.types:
            return float(value)
        if kind in self.types or "object" in self.types:
            return value
        raise ParameterError(
            f"parameter {self.name} is {value!r}: expected {' or '.join(self.types)}, "
            f"as in {self.name}={self.default!r}"
        )


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
    def parameters(self) -> dict[str, Parameter]:
        """The assignments of the cell tagged ``parameters``, by name."""
        cells = [
            cell.source
            for cell in self.content.cells
            if "parameters" in cell.metadata.get("tags", [])
        ]
        if len(cells) != 1:
            raise TrextonError(
                f"{self.path}: {len(cells)} cells are tagged 'parameters': expected one"
            )
        found = [_parameter(self.path, node) for node in ast.parse(cells[0]).body]
        return {parameter.name: parameter for parameter in found}

    @cached_property
    def code(self) -> dict[str, str]:
        """SHA-256 of every module of this package that the notebook's code reaches."""
        source = "\n".join(cell.source for cell in self.content.cells if cell.cell_type == "code")
        hashes: dict[str, str] = {}
        for node in ast.walk(ast.parse(source)):
            for name in _imported_modules(node):
                hashes |= code_hashes(name)
        return {name: hashes[name] for name in sorted(hashes) if name not in _NOT_AN_INPUT}

    def choose(self, settings: Mapping[str, object]) -> dict[str, object]:
        """All parameters but the given ones: defaults, or `settings` (text or values, checked) in their place."""
        values = {
            name: parameter.default
            for name, parameter in self.parameters.items()
            if name not in GIVEN
        }
        for name, value in settings.items():
            if name not in values:
                raise ParameterError(
                    f"{self.name} has no parameter {name!r}: it has {', '.join(values) or 'none'}"
                )
            parameter = self.parameters[name]
            values[name] = (
                parameter.parse(value) if isinstance(value, str) else parameter.check(value)
            )
        return values


def _parameter(path: Path, node: ast.stmt) -> Parameter:
    """``name = literal`` or ``name: int | None = literal``."""
    try:
        if isinstance(node, ast.AnnAssign):
            value = ast.literal_eval(node.value)
            return Parameter(
                node.target.id,
                value,
                tuple(name.strip() for name in ast.unparse(node.annotation).split("|")),
            )
        (target,) = node.targets
        value = ast.literal_eval(node.value)
        # A default of None alone says nothing about the type.
        return Parameter(
            target.id, value, ("object",) if value is None else (type(value).__name__,)
        )
    except (ValueError, AttributeError, TypeError):
        raise TrextonError(
            f"{path}: {ast.unparse(node)!r} in the parameters cell: expected name = literal value"
        ) from None


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
