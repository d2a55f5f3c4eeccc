"""Things of one's own: how a name becomes a class or module, for every kind that can be added.

A name is an entry of the library's own table, an entry point of an installed package in the group
``trexton.<kind>`` (say ``trexton.motion`` or ``trexton.sinks``), or ``module:name``. Offers
`addresses`, `resolve`, and `import_plugins` for modules that are not installed.
"""

import os
import sys
from collections.abc import Mapping
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from typing import Any

from trexton.base.errors import ParameterError

PLUGINS = "TREXTON_PLUGINS"  # environment variable: modules to import first, with commas between


@cache
def _installed(kind: str) -> dict[str, str]:
    from importlib.metadata import entry_points  # slow to load, and not asked for names of our own

    return {each.name: each.value for each in entry_points(group=f"trexton.{kind}")}


def addresses(kind: str, table: Mapping[str, str]) -> dict[str, str]:
    """``module:name`` or ``module`` by name: the library's `table`, which wins, then installed."""
    return {**table, **{key: at for key, at in _installed(kind).items() if key not in table}}


def resolve(kind: str, name: str, table: Mapping[str, str], *, imports: bool = True) -> Any:
    """The object that `name` stands for.

    Parameters
    ----------
    kind : str
        Such as ``sinks``: names the group of entry points, and the thing in errors.
    name : str
        Of the table, of an entry point, or ``module:name`` itself.
    table : mapping of str to str
        The library's own: name to ``module:name``, or ``module`` for a module.
    imports : bool
        Without, a ``module:name`` that nobody has imported is refused: what a file says must not
        decide which code runs.

    Raises
    ------
    ParameterError
        Nothing has that name, or its module is missing. What a module raises itself passes.
    """
    declared = table.get(name) or addresses(kind, table).get(name)
    module, colon, attribute = (declared or name).partition(":")
    if not declared and not colon:
        offered = ", ".join(addresses(kind, table))
        raise ParameterError(f"{kind} {name!r} is unknown: choose one of {offered}, or module:name")
    if not (declared or imports) and module not in sys.modules:
        raise ParameterError(
            f"{kind} {name!r} is not of the library: name its module with --plugin {module}"
        )
    loaded = _import(module, f"{kind} {name!r}")
    try:
        return getattr(loaded, attribute) if colon else loaded
    except AttributeError:
        raise ParameterError(
            f"{kind} {name!r} is unknown: {module} has no {attribute}, give another name"
        ) from None


def import_plugins(modules: str | None = None) -> None:
    """Import modules of a person's own, so that what their maps name is found: `modules`, with
    commas between, and those of ``$TREXTON_PLUGINS``. Processes that this one starts import them
    too. Raises `ParameterError` where one is missing.
    """
    wanted = [*os.environ.get(PLUGINS, "").split(","), *(modules or "").split(",")]
    os.environ[PLUGINS] = ",".join(dict.fromkeys(filter(None, wanted)))
    for module in filter(None, os.environ[PLUGINS].split(",")):
        _import(module, "plugin")


def _import(module: str, what: str) -> Any:
    if module in sys.modules:
        return sys.modules[module]
    if not is_there(module):
        raise ParameterError(
            f"{what} needs the module {module!r}, which is not here: check its name"
        )
    return import_module(module)


def is_there(module: str) -> bool:
    """Whether a module can be imported, here or beside the working folder."""
    if os.getcwd() not in sys.path and "" not in sys.path:
        sys.path.append(os.getcwd())  # a file beside the flight, as a person types its name
    try:
        return module in sys.modules or find_spec(module) is not None
    except (ImportError, ValueError):  # a parent is missing, or the name is none
        return False
