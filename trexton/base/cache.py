"""Intermediate results are keyed by all that went in: code, parameters and data, never a file's
name. Offers `cached`, the hashes of code behind it, and where the clone keeps its files."""

import ast
import hashlib
import os
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from trexton.base.arrays import DAMAGE, read_arrays
from trexton.base.errors import DataError, ParameterError
from trexton.base.files import atomic_file, digest
from trexton.base.progress import say
from trexton.base.records import software_versions

_PACKAGE = Path(__file__).resolve().parent.parent
CONTENTS = "contents"  # of a file of the cache: its hash
_ADDRESS = re.compile(r"trexton(\.\w+)+:\w+")


def repository_root() -> Path | None:
    """The clone this package runs from, or None for an installed package."""
    root = _PACKAGE.parent
    return root if (root / "pyproject.toml").is_file() and (root / "notebooks").is_dir() else None


def shipped(name: str) -> Path:
    """A folder of the repository that also travels with an installed package: ``notebooks``, ...;
    raises `DataError` where it is in neither place.
    """
    root = repository_root()
    place = (root or _PACKAGE / "_shipped") / name
    if not place.is_dir():
        raise DataError(f"{place} is missing: install trexton again, or work in a whole clone")
    return place


def cache_folder() -> Path:
    """``$TREXTON_CACHE``, else ``data/cache`` of the clone, else the user's cache."""
    if folder := os.environ.get("TREXTON_CACHE"):
        return Path(folder)
    root = repository_root()
    return root / "data" / "cache" if root else Path.home() / ".cache" / "trexton"


@cache
def code_hashes(module: str) -> dict[str, str]:
    """SHA-256 of the source of `module` and of all of this package it imports, however deep,
    without docstrings: what is said of a result does not change it.

    To a package belong the pages, styles and scripts beside its modules. What tables name as
    ``"trexton.module:name"`` counts as imported.
    """
    hashes: dict[str, str] = {}
    waiting = [module]
    while waiting:
        name = waiting.pop()
        if name not in hashes and (entry := _hash_and_imports(name)):
            hashes[name], imported = entry
            waiting += [*imported, name.rpartition(".")[0]]  # its package too, with what lies there
    return dict(sorted(hashes.items()))


@cache
def _hash_and_imports(module: str) -> tuple[str, list[str]] | None:
    """Of one module, read once a process; None for what is no module of this package."""
    package, *inner = module.split(".")
    place = _PACKAGE.joinpath(*inner)
    files = (place / "__init__.py", place.with_suffix(".py")) if package == "trexton" else ()
    file = next((file for file in files if file.is_file()), None)
    if file is None:
        return None
    source, said = file.read_bytes(), set[int]()  # lines of docstrings
    names: list[str] = []
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names += [node.module, *(f"{node.module}.{alias.name}" for alias in node.names)]
        elif isinstance(node, ast.Expr) and isinstance(getattr(node.value, "value", None), str):
            said.update(range(node.lineno - 1, node.end_lineno or 0))
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            if _ADDRESS.fullmatch(node.value):  # in a table of what is imported when asked for
                names.append(node.value.partition(":")[0])
    code = [line for number, line in enumerate(source.splitlines()) if number not in said]
    total = hashlib.sha256(b"\n".join(code))
    for beside in sorted(place.glob("*")):  # what the modules of a package read
        if beside.suffix in (".css", ".html", ".js"):
            total.update(beside.read_bytes())
    return total.hexdigest(), names


def cached(
    kind: str, module: str, inputs: dict[str, Any], compute: Callable[[], dict[str, np.ndarray]]
) -> dict[str, np.ndarray]:
    """Return the arrays that `compute` gives, from the cache if the same inputs were seen before.

    Of processes that ask for the same at once, one computes it and the others wait.

    `kind` is a word that names the file, for people; `module` the one whose code, with all that it
    imports from this package, makes the result; `inputs` are JSON values, parameters and hashes.
    """
    key = digest(kind, inputs, code_hashes(module), software_versions())
    path = cache_folder() / f"{kind}-{key[:24]}.npz"
    with _turn(path):
        if (stored := _stored(path)) is not None:
            return stored
        arrays = {name: np.asarray(array) for name, array in compute().items()}
        try:
            with atomic_file(path, "wb") as stream:
                save: Any = np.savez  # whose stubs take every name for an option
                save(stream, **arrays, **{CONTENTS: np.array(_contents(arrays))})
        except (OSError, ParameterError) as error:  # full, not ours: what was computed is right
            say(f"{path.parent}: nothing is kept there ({error})")
    return arrays


@contextmanager
def _turn(path: Path) -> Iterator[None]:
    """Wait until no other process makes this file; where none can be kept, nobody waits."""
    from filelock import FileLock  # here, for flying needs none

    lock = path.with_suffix(".lock")
    with ExitStack() as held:
        with suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            held.enter_context(FileLock(lock))
            held.callback(lock.unlink, missing_ok=True)  # who waits for it notices
        yield


def _stored(path: Path) -> dict[str, np.ndarray] | None:
    """What a file of the cache holds; None where there is none, or none that is whole."""
    if not path.is_file():
        return None
    try:
        arrays = read_arrays(path)
        if str(arrays.pop(CONTENTS)) != _contents(arrays):
            raise DataError("it holds other arrays than were written")
        return arrays
    except (DataError, *DAMAGE) as error:
        say(f"{path}: not whole ({str(error) or type(error).__name__}): made again")
        return None


def _contents(arrays: dict[str, np.ndarray]) -> str:
    return digest(*(each for item in sorted(arrays.items()) for each in item))
