"""Declared options become arguments of a command. Offers `add_options`, a group for a class of
options, and `add_assignments`, ``--set`` for pairs.

::

    add_options(parser, Parameters)  # an `Options` class; --particles, in a group of its own
    chosen_options(parser.parse_args(), Parameters)  # the object, checked
"""

import argparse
from collections.abc import Iterable
from typing import Any, TypeVar

from trexton.base.errors import ParameterError
from trexton.base.options import Option, Options

T = TypeVar("T", bound=Options)
_METAVARS: dict[type, str] = {int: "N", float: "X"}


def add_options(parser: argparse.ArgumentParser, kind: type[Options]) -> None:
    """Give the parser a group for a class of options, an argument each; see `chosen_options`."""
    group = parser.add_argument_group((kind.__doc__ or "").strip().partition("\n")[0].rstrip("."))
    for each in kind.declared():
        default = "" if each.default in (None, "", False) else f" (default {each.default})"
        add_option(group, kind.flag(each.name), each, each.meaning + default, _place(kind, each))


def add_option(
    group: argparse._ActionsContainer, flag: str, each: Option, words: str, place: str
) -> None:
    """Add one argument: a switch for a bool, else with a value that is left as it is typed.

    Parameters
    ----------
    flag, words : str
        How it is typed, and its help.
    place : str
        The attribute of the parsed arguments; missing where it is not given.
    """
    words = words.replace("%", "%%")
    how: dict[str, Any] = {"dest": place, "default": argparse.SUPPRESS, "help": words}
    if bool in each.types:
        group.add_argument(flag, action="store_true", **how)
    else:
        metavar = "|".join(each.choices) or _METAVARS.get(each.types[0], each.name.upper())
        group.add_argument(flag, metavar=metavar, **how)


def chosen_options(arguments: argparse.Namespace, kind: type[T]) -> T:
    """The options of a class as they were typed; raises `ParameterError`, which names the flag."""
    typed = {
        each.name: getattr(arguments, _place(kind, each))
        for each in kind.declared()
        if hasattr(arguments, _place(kind, each))
    }
    try:
        return kind.parse(typed)
    except ParameterError as error:
        name = next((name for name in typed if f"parameter {name} is" in str(error)), None)
        raise ParameterError(f"{kind.flag(name)}: {error}" if name else str(error)) from None


def _place(kind: type[Options], each: Option) -> str:
    return f"{kind.__name__}.{each.name}"


def add_assignments(parser: argparse.ArgumentParser, metavar: str, words: str) -> None:
    """Give the parser ``--set``, repeatable; see `assignments`. `words` are its help."""
    parser.add_argument(
        "--set", nargs="+", action="extend", default=[], metavar=metavar, dest="settings",
        help=words,
    )  # fmt: skip


def assignments(words: Iterable[str], form: str) -> dict[str, str]:
    """What was typed after ``--set``, ``key=value`` words, as a mapping.

    `ParameterError` where a word is none, or a key comes twice; it says that `form` was expected.
    """
    pairs: dict[str, str] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or not key:
            raise ParameterError(f"--set {word!r}: expected {form}")
        if key in pairs:
            raise ParameterError(
                f"--set has {key} twice, {pairs[key]!r} and {value!r}: give it once, as {form}"
            )
        pairs[key] = value
    return pairs
