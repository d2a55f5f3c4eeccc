"""Methods: named sets of parts. The only place that knows which parts go together."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from trexton.base.errors import ParameterError
from trexton.base.options import assignments
from trexton.localization.base import Part
from trexton.localization.roles import check_known, check_role, make, name_of

__all__ = ["METHODS", "changed", "compose", "parse_choices"]

# A method names a distance, a filter, and a part for each other role that its filter asks for;
# "role.option" gives an option another value.
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
        "distance": "hellinger",
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
        A role, part or option is unknown, or a value does not fit.
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
    return result


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
