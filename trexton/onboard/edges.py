"""Edges that declare themselves: a sink or a source is one class that says what it is called, what
its address looks like, and which options it has.

From the declaration come the command line's group, the checks and the table of the documentation.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping
from importlib import import_module
from types import NoneType
from typing import Any

from trexton.base.errors import ParameterError
from trexton.base.options import Option, Options

__all__ = ["Edge", "add_options", "chosen_options", "load", "markdown_table"]


class Edge:
    """What every sink and source declares.

    Attributes
    ----------
    addresses : dict of str to str
        How it may be asked for, as a person types it, and what that means.
    options : type
        An `Options` dataclass; its docstring names the group on the command line.
    prefix : str
        Goes before its options there, so that no two are alike: ``--PREFIX-OPTION``.
    """

    addresses: Mapping[str, str] = {}
    options: type[Options] = Options
    prefix = ""

    @classmethod
    def flag(cls, name: str) -> str:
        """The word of the command line that sets an option."""
        return "--" + "-".join(filter(None, (cls.prefix, name.replace("_", "-"))))


def load(place: str) -> type[Any]:
    """The class at ``module:name``."""
    module, _, name = place.partition(":")
    edge: type[Any] = getattr(import_module(module), name)
    return edge


def _declared(edges: Iterable[type[Edge]]) -> dict[type[Options], type[Edge]]:
    """Each class of options once, with an edge that has it."""
    found: dict[type[Options], type[Edge]] = {}
    for edge in edges:
        if any(edge.options.declared()):
            found.setdefault(edge.options, edge)
    return found


def add_options(parser: argparse.ArgumentParser, edges: Iterable[type[Edge]]) -> None:
    """Give the parser a group for each class of options, an argument for each option."""
    for options, edge in _declared(edges).items():
        group = parser.add_argument_group(
            (options.__doc__ or "").strip().splitlines()[0].rstrip(".")
        )
        for each in options.declared():
            flag, default = edge.flag(each.name), each.default
            shown = "" if default in (None, "", False) else f" (default {default})"
            if bool in each.types:
                group.add_argument(flag, dest=_dest(edge, each), action="store_true",
                                   default=None, help=each.meaning + shown)  # fmt: skip
                continue
            metavar = "|".join(each.choices) if each.choices else _metavar(each)
            group.add_argument(flag, dest=_dest(edge, each), metavar=metavar, default=None,
                               help=each.meaning + shown)  # fmt: skip


def chosen_options(
    arguments: argparse.Namespace, edges: Iterable[type[Edge]]
) -> dict[type[Options], Options]:
    """The options of every class as they were typed; raises `ParameterError` where one is wrong."""
    chosen: dict[type[Options], Options] = {}
    for options, edge in _declared(edges).items():
        typed = {
            each.name: getattr(arguments, _dest(edge, each))
            for each in options.declared()
            if getattr(arguments, _dest(edge, each), None) is not None
        }
        try:
            chosen[options] = options.parse(typed)
        except ParameterError as error:
            name = next((name for name in typed if f"parameter {name} is" in str(error)), None)
            flag = f"{edge.flag(name)}: " if name else ""
            raise ParameterError(f"{flag}{error}") from None
    return chosen


def _dest(edge: type[Edge], each: Option) -> str:
    return f"{edge.options.__name__}.{each.name}"


def _metavar(each: Option) -> str:
    kinds = [kind for kind in each.types if kind is not NoneType]
    return {int: "N", float: "X"}.get(kinds[0], each.name.upper())


def markdown_table(edges: Iterable[type[Edge]], flag: str) -> str:
    """The table of the documentation: addresses and what they mean, then the options."""
    edges = list(dict.fromkeys(edges))
    rows = [f"| `{flag}` | |", "|---|---|"]
    rows += [f"| `{address}` | {meaning} |" for edge in edges
             for address, meaning in edge.addresses.items()]  # fmt: skip
    options = [
        (edge, each) for edge in _declared(edges).values() for each in edge.options.declared()
    ]
    if options:
        rows += ["", "| option | default | |", "|---|---|---|"]
    for edge, each in options:
        default = "" if each.default in (None, "", False) else f"`{each.default}`"
        rows.append(f"| `{edge.flag(each.name)}` | {default} | {each.meaning} |")
    return "\n".join(rows) + "\n"
