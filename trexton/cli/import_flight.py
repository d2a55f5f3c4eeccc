"""``trexton import [KIND] SOURCE --out FLIGHT``: an option for each setting that an importer
declares.
"""

from __future__ import annotations

import argparse
from typing import Any

from trexton.base.options import Option
from trexton.base.progress import say

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from trexton.flights.importers import IMPORTERS, importer
    from trexton.flights.importing import Common

    kinds = f"{', '.join(IMPORTERS)} (guessed unless given), and file or folder"
    parser.add_argument("what", nargs="+", metavar="[KIND] SOURCE", help=kinds)
    parser.add_argument("--out", required=True, metavar="FLIGHT", help="the Flight folder to write")
    parser.add_argument(
        "--replace", action="store_true", help="replace the Flight folder that is there"
    )
    common = parser.add_argument_group("whatever the source")
    taken: dict[str, list[str]] = {}
    for each in Common.declared():
        taken[each.name] = [each.meaning]
        _add(common, each, f"{each.meaning} (default {each.default or 'none'})")
    words: dict[str, list[str]] = {}
    options = {}
    for kind in IMPORTERS:
        for each in importer(kind).Settings.declared():
            options[each.name] = each
            words.setdefault(each.name, []).append(f"{kind}: {each.meaning}")
    group = parser.add_argument_group("of one kind")
    for name, meanings in words.items():
        if name not in taken:
            _add(group, options[name], "; ".join(meanings))


def _add(group: argparse._ArgumentGroup, option: Option, words: str) -> None:
    switch: dict[str, Any] = {"nargs": "?", "const": "yes"} if option.types == (bool,) else {}
    group.add_argument(
        f"--{option.name.replace('_', '-')}",
        dest=option.name,
        default=argparse.SUPPRESS,
        metavar="VALUE",
        help=words.replace("%", "%%"),
        **switch,
    )


def run(arguments: argparse.Namespace) -> int:
    from trexton.base.errors import ParameterError
    from trexton.flights.importing import import_flight

    given = {
        name: value
        for name, value in vars(arguments).items()
        if name not in ("what", "out", "replace", "command", "quiet")
    }
    if len(arguments.what) > 2:
        raise ParameterError(
            f"{' '.join(arguments.what)}: expected a kind and a source, or a source"
        )
    *kind, source = arguments.what
    flight, said = import_flight(
        source,
        arguments.out,
        kind=kind[0] if kind else None,
        settings=given,
        replaced=arguments.replace,
    )
    for line in said:
        say(line)
    seconds = flight.time[-1] - flight.time[0]
    say(
        f"{arguments.out}: {len(flight)} frames, {seconds:.1f} s; next: trexton check "
        f"{arguments.out}"
    )
    return 0
