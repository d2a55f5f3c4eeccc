"""Methods: named sets of parts. The only place that knows which parts go together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from trexton.base.arguments import assignments
from trexton.base.errors import ParameterError
from trexton.base.plugins import names
from trexton.localization.base import Part
from trexton.localization.roles import ROLES, check_known, check_role, make, name_of, part_class

__all__ = ["ALWAYS", "METHODS", "changed", "check_fit", "compose", "parse_choices", "roles_read"]

# Roles that the localizer itself reads, whatever the filter.
ALWAYS = ("view", "calibration", "integrity")

# A method names a filter and the parts that it needs, and those that they need; "role.option" gives
# an option another value.
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
    # The paper's filter as one may fly it: it finds its way back, and says how far it may be off.
    "guarded": {
        "distance": "euclidean",
        "motion": "random-walk",
        "measurement": "rank-mixture",
        "filter": "particles",
        "resampling": "wheel",
        "estimation": "map",
        "recovery": "augmented",
        "calibration": "replay",
        "integrity": "elsewhere",
    },
    "field": {
        "motion": "singer",
        "measurement": "field",
        "filter": "tracks",
    },
    "fine": {
        "distance": "euclidean",
        "motion": "random-walk",
        "measurement": "rank-mixture",
        "filter": "registration",
    },
}


def compose(method: str) -> dict[str, Part]:
    """The parts of a method by role, before they have learned anything.

    Raises
    ------
    ParameterError
        There is no such method.
    """
    if method not in METHODS:
        raise ParameterError(f"method {method!r} is unknown: choose one of {', '.join(METHODS)}")
    return changed({}, METHODS[method])


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
    for key, choice in choices.items():
        role, dot, _ = key.partition(".")
        check_known(role)
        if dot:
            continue
        if isinstance(choice, Part):
            check_role(role, type(choice))
            result[role] = choice
        elif not isinstance(choice, str):
            raise ParameterError(f"{role} is {choice!r}: expected a part or its name")
        elif role not in parts or name_of(role, parts[role]) != choice:
            result[role] = make(role, choice)
    for key, value in choices.items():
        role, dot, option = key.partition(".")
        if not dot:
            continue
        part = result.get(role) or parts.get(role)
        if part is None:
            raise ParameterError(f"{key} is chosen without a {role}: choose one, as in {role}=...")
        value = part.option(option, value)
        if part.options()[option] != value:
            result[role] = part.with_options(**{option: value})
    check_fit({**parts, **result}, [key.partition(".")[0] for key in choices])
    return result


def roles_read(parts: Mapping[str, Part]) -> dict[str, tuple[str, type[Part]]]:
    """Which roles a method reads: each with the role of a part that reads it, and of which base.

    Calibration, integrity and view serve any method: the localizer itself reads them.
    """
    read: dict[str, tuple[str, type[Part]]] = {}
    waiting = ["filter", *(role for role in ALWAYS if role in parts)]
    while waiting:
        reader = waiting.pop(0)
        if reader not in parts:
            continue
        asked = {role: Part for role in parts[reader].uses} | dict(parts[reader].needs)
        for role, base in asked.items():
            if role not in read:
                waiting.append(role)
            read[role] = (reader, base)
    return read


def check_fit(parts: Mapping[str, Part], chosen: Iterable[str] = ()) -> None:
    """Refuse parts that do not fit each other, and choices that nothing would read.

    Parameters
    ----------
    parts : mapping of role to Part
        A whole method.
    chosen : iterable of str
        The roles that a person named.

    Raises
    ------
    ParameterError
        A part lacks one that it needs, or was given one of another kind; or a chosen role is read
        by no part of the method.
    """
    read = roles_read(parts)
    for role in chosen:
        if role not in read and role not in ("filter", *ALWAYS):
            reads = ", ".join(each for each in ROLES if each in (*read, *ALWAYS))
            raise ParameterError(
                f"{role} would change nothing: with filter {name_of('filter', parts['filter'])!r} "
                f"a method reads {reads}: leave it out, or choose another method"
            )
    for role, (reader, base) in read.items():
        what = f"{reader} {name_of(reader, parts[reader])!r}"
        if role in parts and not isinstance(parts[role], base):
            raise ParameterError(
                f"{role} {name_of(role, parts[role])!r} does not fit {what}, which needs a "
                f"{base.__name__}: choose one of {_fitting(role, base)}"
            )
        if role in parts[reader].needs and role not in parts:
            raise ParameterError(
                f"{what} needs a {role}: choose one, as in {role}={_fitting(role, base)}"
            )


def _fitting(role: str, base: type[Part]) -> str:
    fit = (name for name in names(role, ROLES[role]) if issubclass(part_class(role, name), base))
    return ", ".join(fit) or f"a subclass of {base.__module__}:{base.__qualname__}"


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
