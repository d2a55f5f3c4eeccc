"""Edges that declare themselves: a sink or a source is one class that says what it is called, what
its address looks like, and which options it has.

From the declaration come the command line's group, the checks and the table of the book.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import Any

from trexton.base.errors import ParameterError
from trexton.base.options import Options
from trexton.base.plugins import addresses, is_there, resolve

_OWN = re.compile(r"([A-Za-z_][\w.]*:[A-Za-z_]\w*)(?::(.*))?", re.S)  # module:Class[:REST]


class Edge:
    """What every sink and source declares."""

    addresses: Mapping[str, str] = {}  # how it may be asked for, as typed, and what that means
    options: type[Options] = Options  # its docstring names the group on the command line

    @classmethod
    def make(cls, address: str, options: Any, around: Any) -> Edge:
        """The edge at `address`, what was typed after the kind and its colon, not yet opened;
        `around` holds what it may need to know beside its options.
        """
        raise NotImplementedError(f"{cls.__name__} is made by hand, not by an address")


def edge_at(kind: str, address: str, table: Mapping[str, str]) -> tuple[Any, str, str] | None:
    """The class that ``NAME:REST`` or ``module:Class:REST`` names, that name, and the rest; None
    where it names no class. `kind` is ``sinks`` or ``sources``, and `table` the library's own.
    """
    name, _, rest = address.partition(":")
    if name in table or name in addresses(kind, table):
        return resolve(kind, name, table), name, rest
    own = _OWN.fullmatch(address)
    if own is None or not is_there(own[1].partition(":")[0]):
        return None
    edge = resolve(kind, own[1], table)
    if not (isinstance(edge, type) and issubclass(edge, Edge)):
        raise ParameterError(f"{own[1]} is none of the {kind}: make it a subclass of their base")
    return edge, own[1], own[2] or ""


def edge_classes(
    kind: str, table: Mapping[str, str], typed: Iterable[str] = (), *, installed: bool = True
) -> list[Any]:
    """Every class of a kind once: the library's, those of `installed` packages, which takes long,
    and those that the words of a command line name as ``module:Class``.
    """
    own = [found[0] for word in typed if _OWN.match(word) and (found := edge_at(kind, word, table))]
    names = addresses(kind, table) if installed else table
    return list(dict.fromkeys([resolve(kind, name, table) for name in names] + own))


def classes_of_options(edges: Iterable[type[Edge]]) -> list[type[Options]]:
    """Each class of options that has any, once."""
    return list(dict.fromkeys(each.options for each in edges if any(each.options.declared())))
