"""``trexton import [KIND] SOURCE --out FLIGHT``: a flight of another format. It is checked."""

import argparse
from typing import Any

from trexton.base.arguments import add_option
from trexton.base.errors import ParameterError
from trexton.base.options import Option
from trexton.base.plugins import addresses
from trexton.base.progress import say
from trexton.flights.importers import IMPORTERS, importer
from trexton.flights.importing import Common, import_flight, preview_import

PLACE = "setting."  # what the attributes of settings begin with


def _let_words_follow_options(parser: argparse.ArgumentParser) -> None:
    """A kind may stand before the options and the source behind them."""
    parse = parser.parse_known_args

    def intermixed(args: Any = None, namespace: Any = None) -> tuple[Any, list[str]]:
        parsed, left = parse(args, namespace)
        parsed.what += [word for word in left if not word.startswith("-")]
        return parsed, [word for word in left if word.startswith("-")]

    parser.parse_known_args = intermixed  # type: ignore[method-assign]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    kinds = f"{', '.join(IMPORTERS)} (guessed unless given), and file or folder"
    parser.add_argument("what", nargs="+", metavar="[KIND] SOURCE", help=kinds)
    _let_words_follow_options(parser)
    parser.add_argument("--out", metavar="FLIGHT", help="the Flight folder to write")
    words = "write nothing: print which columns, units, frames and clock would be taken for what"
    parser.add_argument("--dry-run", action="store_true", help=words)
    parser.add_argument("--replace", action="store_true", help="replace the Flight folder there")
    group = parser.add_argument_group("whatever the source")
    common = {each.name: each for each in Common.declared()}
    for name, each in common.items():
        words = f"{each.meaning} (default {each.default or 'none'})"
        add_option(group, Common.flag(name), each, words, PLACE + name)
    options: dict[str, Option] = {}  # several kinds may have one of a name
    meanings: dict[str, dict[str, list[str]]] = {}  # of an option, and of which kinds
    for kind in addresses("importers", IMPORTERS):
        for each in importer(kind).Settings.declared():
            options[each.name] = each
            meanings.setdefault(each.name, {}).setdefault(each.meaning, []).append(kind)
    group = parser.add_argument_group("of one kind")
    for name in (name for name in options if name not in common):
        said = meanings[name].items()
        words = "; ".join(f"{', '.join(kinds)}: {meaning}" for meaning, kinds in said)
        add_option(group, Common.flag(name), options[name], words, PLACE + name)


def run(arguments: argparse.Namespace) -> int:
    *kind, source = arguments.what
    if len(kind) > 1:
        raise ParameterError(f"{' '.join(arguments.what)}: expected a source, or kind and source")
    chosen = kind[0] if kind else None
    settings: dict[str, object] = {
        name.removeprefix(PLACE): value
        for name, value in vars(arguments).items()
        if name.startswith(PLACE)
    }
    if arguments.dry_run:
        rows = preview_import(source, kind=chosen, settings=settings)
        width = max(len(name) for name, _ in rows)
        print("\n".join(f"{name:<{width}}  {text}" for name, text in rows))
        return 0
    if not arguments.out:
        raise ParameterError("name the folder to write with --out, or say --dry-run")
    flight, remarks = import_flight(
        source, arguments.out, kind=chosen, settings=settings, replaced=arguments.replace
    )
    seconds = flight.time[-1] - flight.time[0]
    said = f"{len(flight)} frames, {seconds:.1f} s; next: trexton check {arguments.out}"
    say("\n".join([*remarks, f"{arguments.out}: {said}"]))
    return 0
