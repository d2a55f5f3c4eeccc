"""``trexton methods [NAME]``: what can be chosen. Methods, their parts, the options of each."""

import argparse
import inspect
from collections.abc import Iterator

from trexton.base.errors import ParameterError
from trexton.base.plugins import addresses
from trexton.localization.base import Part
from trexton.localization.methods import METHODS, ROLES, part_class


def add_arguments(parser: argparse.ArgumentParser) -> None:
    words = f"a method or a role, or role=module:Class (default all): {', '.join(ROLES)}"
    parser.add_argument("name", nargs="?", metavar="NAME", help=words)


def run(arguments: argparse.Namespace) -> int:
    role, equals, part = (arguments.name or "").partition("=")
    if role and role not in METHODS and role not in ROLES:
        offered = ", ".join([*METHODS, *ROLES])
        raise ParameterError(f"{role!r} is no method or role: choose one of {offered}")
    for name, parts in METHODS.items():
        if role in ("", name):
            print(f"method {name}: {' '.join(f'{key}={value}' for key, value in parts.items())}")
    for each, table in ROLES.items():
        if role in ("", each) or each in METHODS.get(role, {}):
            listed = [part] if equals else addresses(each, table)
            chosen = METHODS.get(role, {}).get(each)
            for name in [chosen] if chosen else listed:
                print("\n".join(_lines(f"{each}={name}", part_class(each, name))))
    return 0


def _lines(name: str, kind: type[Part]) -> Iterator[str]:
    summary = (inspect.getdoc(kind) or "").partition("\n\n")[0]
    yield f"{name}: {' '.join(summary.split())}"
    if kind.needs or kind.uses:
        needs = [f"{role} ({each.__name__})" for role, each in kind.needs.items()]
        uses = [f"{role} where there is one" for role in kind.uses]
        yield f"  reads {', '.join(needs + uses)}"
    yield from (f"  {option}" for option in kind.declared())
