"""Methods: named sets of parts. `compose` makes those of a method, `changed` applies what a person
chose, and `fitting` checks that all of them are read.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from trexton.base.arguments import assignments
from trexton.base.errors import ParameterError
from trexton.base.plugins import addresses
from trexton.localization.base import Part
from trexton.localization.roles import ROLES, check_known, check_role, make, name_of, part_class

__all__ = ["METHODS", "changed", "compose", "fitting", "parse_choices"]

# What the localizer and training read of every method; a filter says itself what else it needs.
ROOTS = ("filter", "view", "appearance")
# A method names a filter, and a part for each other role that is needed; "role.option" gives an
# option another value.
METHODS: dict[str, dict[str, Any]] = {
    "paper": {
        "distance": "euclidean",
        "motion": "random-walk",
        "measurement": "rank-mixture",
        "filter": "particles",
        "resampling": "wheel",
        "estimation": "map",
        "recovery": "none",
    },
    "field": {
        "motion": "singer",
        "measurement": "field",
        "filter": "tracks",
        "appearance": "tracked",
    },
    # A baseline: the training frames as the states of a hidden Markov model.
    "hmm": {"distance": "hellinger", "motion": "random-walk", "filter": "hmm"},
    "fine": {
        "distance": "euclidean",
        "motion": "random-walk",
        "measurement": "rank-mixture",
        "filter": "registration",
    },
}


def compose(method: str, choices: Mapping[str, object] | None = None) -> dict[str, Part]:
    """The parts of a method by role, before they have learned anything.

    Parameters
    ----------
    method : str
    choices : mapping, optional
        Replace what the method says, see `changed`.

    Raises
    ------
    ParameterError
        There is no such method, or a choice does not fit.
    """
    if method not in METHODS:
        raise ParameterError(f"method {method!r} is unknown: choose one of {', '.join(METHODS)}")
    parts = changed({}, METHODS[method])
    return fitting(parts | changed(parts, choices or {}))


def changed(parts: Mapping[str, Part], choices: Mapping[str, object]) -> dict[str, Part]:
    """The parts that `choices` make other than they are, not yet trained.

    Parameters
    ----------
    parts : mapping of role to Part
    choices : mapping
        ``role``: a part, or its name; ``role.option``: a value.

    Raises
    ------
    ParameterError
        A role, part or option is unknown, a value or a part does not fit, or nothing reads it.
    """
    result: dict[str, Part] = {}
    options: dict[str, dict[str, object]] = {}
    for key, choice in choices.items():
        role, dot, option = key.partition(".")
        check_known(role)
        if dot:
            options.setdefault(role, {})[option] = choice
        elif isinstance(choice, Part):
            check_role(role, type(choice))
            result[role] = choice
        elif not isinstance(choice, str):
            raise ParameterError(f"{role} is {choice!r}: expected a part or its name")
        elif role not in parts or name_of(role, parts[role]) != choice:
            result[role] = make(role, choice)
    for role, settings in options.items():
        part = result.get(role) or parts.get(role)
        if part is None:
            key = f"{role}.{next(iter(settings))}"
            raise ParameterError(f"{key} is chosen without a {role}: choose one, as in {role}=...")
        values = part.checked(settings, f"{role} {name_of(role, part)!r}")
        if part.as_dict() != part.as_dict() | values:
            result[role] = part.with_options(**values)
    fitting({**parts, **result}, choices)
    return result


def fitting(parts: Mapping[str, Part], chosen: Iterable[str] = ()) -> dict[str, Part]:
    """Those of the parts that are read: by the localizer, by the filter, or by a part that is.

    Parameters
    ----------
    parts : mapping of role to Part
    chosen : iterable of str
        ``role`` or ``role.option``, chosen by a person: these must be read.

    Raises
    ------
    ParameterError
        A part lacks one that it needs, was given one that it cannot read, or a chosen one is read
        by none.
    """
    if "filter" not in parts:
        raise ParameterError("filter is missing: a method needs one")
    read: dict[str, Part] = {}
    waiting = [role for role in ROOTS if role in parts]
    while waiting:
        role = waiting.pop()
        if role in read:
            continue
        read[role] = parts[role]
        _check_needs(role, parts)
        waiting += [each for each in (*parts[role].needs, *parts[role].uses) if each in parts]
    for role in (key.partition(".")[0] for key in chosen):
        if role not in read:
            asked = {each for part in read.values() for each in (*part.needs, *part.uses)}
            reads = ", ".join(each for each in ROLES if each in (*asked, *ROOTS))
            raise ParameterError(
                f"{role} would change nothing: with filter {name_of('filter', parts['filter'])!r} "
                f"a method reads {reads}: leave it out, or choose another method"
            )
    return {role: part for role, part in parts.items() if role in read}


def _check_needs(role: str, parts: Mapping[str, Part]) -> None:
    """Raise `ParameterError` unless all are there that the part of a role needs."""
    what = f"{role} {name_of(role, parts[role])!r}"
    for other, base in parts[role].needs.items():
        if isinstance(parts.get(other), base):
            continue
        kinds = {name: part_class(other, name) for name in addresses(other, ROLES[other])}
        fit = [name for name, kind in kinds.items() if issubclass(kind, base)]
        offered = ", ".join(fit) or f"a subclass of {base.__module__}:{base.__qualname__}"
        if other not in parts:
            raise ParameterError(f"{what} needs a {other}: choose one, as in {other}={offered}")
        raise ParameterError(
            f"{other} {name_of(other, parts[other])!r} does not fit {what}, which needs a "
            f"{base.__name__}: choose one of {offered}"
        )


def parse_choices(words: Iterable[str]) -> dict[str, str]:
    """Choices from ``role=part`` and ``role.option=value`` words of a command line.

    Raises
    ------
    ParameterError
        A word is neither, comes twice, or has an unknown role.
    """
    form = "role=part or role.option=value"
    choices = assignments(words, form)
    for key, value in choices.items():
        if not value:
            raise ParameterError(f"--set '{key}=': expected {form}")
        check_known(key.partition(".")[0])
    return choices
