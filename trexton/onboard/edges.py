"""Edges that declare themselves: a sink or a source is one class that says what it is called, what
its address looks like, and which options it has.

From the declaration come the command line's group, the checks and the table of the documentation.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from importlib import import_module
from typing import Any

from trexton.base.options import Options

__all__ = ["Edge", "classes_of_options", "load", "markdown_table"]


class Edge:
    """What every sink and source declares.

    Attributes
    ----------
    addresses : dict of str to str
        How it may be asked for, as a person types it, and what that means.
    options : type
        An `Options` dataclass; its docstring names the group on the command line.
    """

    addresses: Mapping[str, str] = {}
    options: type[Options] = Options


def load(place: str) -> type[Any]:
    """The class at ``module:name``."""
    module, _, name = place.partition(":")
    edge: type[Any] = getattr(import_module(module), name)
    return edge


def classes_of_options(edges: Iterable[type[Edge]]) -> list[type[Options]]:
    """Each class of options that has any, once."""
    return list(dict.fromkeys(each.options for each in edges if any(each.options.declared())))


def markdown_table(edges: Iterable[type[Edge]], flag: str) -> str:
    """The table of the documentation: addresses and what they mean, then the options."""
    edges = list(dict.fromkeys(edges))
    rows = [f"| `{flag}` | |", "|---|---|"]
    rows += [f"| `{address}` | {meaning} |" for edge in edges
             for address, meaning in edge.addresses.items()]  # fmt: skip
    options = [(kind, each) for kind in classes_of_options(edges) for each in kind.declared()]
    if options:
        rows += ["", "| option | default | |", "|---|---|---|"]
    for kind, each in options:
        default = "" if each.default in (None, "", False) else f"`{each.default}`"
        rows.append(f"| `{kind.flag(each.name)}` | {default} | {each.meaning} |")
    return "\n".join(rows) + "\n"
