"""The paper's published numbers. They are read from ``data/paper/published.toml``."""

from functools import lru_cache
from pathlib import Path
from typing import Any

from trexton.base.cache import shipped
from trexton.base.files import read_toml


def paper_file(name: str) -> Path:
    """The file `name` of ``data/paper``; raises `DataError` where the installation is not whole."""
    return shipped("data/paper") / name


@lru_cache
def published() -> dict[str, Any]:
    """All published values, by experiment."""
    return read_toml(paper_file("published.toml"))


def look_up(tree: Any, path: str) -> Any:
    """The entry at a dotted `path` of nested dicts; None where there is none."""
    for key in path.split("."):
        if not isinstance(tree, dict) or key not in tree:
            return None
        tree = tree[key]
    return tree
