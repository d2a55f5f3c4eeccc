"""Methods: named sets of parts, one a role, and the parts of the library by name.

`compose` makes the parts of a method, `changed` applies what a person chose, and `fitting` checks
that all are read. A part of one's own needs no entry: see `trexton.base.plugins`, where a role is a
kind.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from trexton.base.errors import ParameterError
from trexton.base.plugins import addresses, resolve
from trexton.localization.base import Part

# role: {name: where the class is}. Loaded when asked for, so that a heavy part costs nothing where
# it does not fly.
ROLES: dict[str, dict[str, str]] = {
    "distance": {
        "euclidean": "trexton.localization.neighbors:Euclidean",
        "hellinger": "trexton.localization.neighbors:Hellinger",
        "chi-square": "trexton.localization.neighbors:ChiSquare",
    },
    "appearance": {
        "none": "trexton.field.appearance:AsSurveyed",
        "tracked": "trexton.field.appearance:Tracked",
    },
    "odometry": {"visual": "trexton.localization.odometry:Visual"},
    "motion": {
        "random-walk": "trexton.localization.motion:RandomWalk",
        "singer": "trexton.field.linear_motion:Singer",
    },
    "measurement": {
        "rank-mixture": "trexton.localization.measurement:RankMixture",
        "field": "trexton.field.field:Field",
    },
    "filter": {
        "particles": "trexton.localization.filters:Particles",
        "tracks": "trexton.field.tracks:Tracks",
        "hmm": "trexton.localization.hidden_markov:HiddenMarkov",
        "registration": "trexton.registration.filter:Registration",
    },
    "resampling": {
        "wheel": "trexton.localization.particle_parts:Wheel",
        "systematic": "trexton.localization.particle_parts:Systematic",
    },
    "estimation": {
        "map": "trexton.localization.particle_parts:MaximumAPosteriori",
        "mean": "trexton.localization.particle_parts:WeightedMean",
        "highest-weight": "trexton.localization.particle_parts:HighestWeight",
    },
    "recovery": {
        "none": "trexton.localization.particle_parts:NoRecovery",
        "augmented": "trexton.localization.particle_parts:Augmented",
    },
}
# What the localizer and training read of every method; a filter says itself what else it needs.
ROOTS = ("filter", "appearance")
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
    "fine": {"motion": "random-walk", "filter": "registration"},
}


def compose(method: str, choices: Mapping[str, object] | None = None) -> dict[str, Part]:
    """The parts of a method by role, before they have learned anything.

    `choices` replace what the method says, see `changed`, which raises the same `ParameterError`
    as where there is no such method.
    """
    if method not in METHODS:
        raise ParameterError(f"method {method!r} is unknown: choose one of {', '.join(METHODS)}")
    parts = changed({}, METHODS[method])
    return fitting(parts | changed(parts, choices or {}))


def changed(parts: Mapping[str, Part], choices: Mapping[str, object]) -> dict[str, Part]:
    """The parts that `choices` make other than they are, not yet trained: of a ``role`` a part or
    its name, of a ``role.option`` a value.

    Raises `ParameterError` where one is unknown, does not fit, or where nothing reads it.
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

    Raises `ParameterError` where a part lacks one that it needs, was given one that it cannot read,
    or where none reads a ``role`` or ``role.option`` that a person has `chosen`.
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
            raise ParameterError(
                f"{role} would change nothing: with filter {name_of('filter', parts['filter'])!r} "
                "a method reads none, leave it out, or choose another method"
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
    """Choices from words of a command line; `ParameterError` for one that names no role."""
    from trexton.base.arguments import assignments  # a command line's, which no map needs

    choices = assignments(words, "role=part or role.option=value")
    for key in choices:
        check_known(key.partition(".")[0])
    return choices


def check_known(role: str) -> None:
    """Raise `ParameterError` unless there is such a role."""
    if role not in ROLES:
        raise ParameterError(f"part {role!r} is unknown: choose one of {', '.join(ROLES)}")


def check_role(role: str, kind: object) -> None:
    """Raise `ParameterError` unless a part of this class fills the role."""
    first = resolve(role, next(iter(ROLES[role])), ROLES[role])
    base = next(each for each in first.__mro__ if Part in each.__bases__)
    if not (isinstance(kind, type) and issubclass(kind, base)) or kind is base:
        name = getattr(kind, "__qualname__", kind)
        raise ParameterError(
            f"{role} is {name}: expected a subclass of {base.__module__}.{base.__qualname__}"
        )


def part_class(role: str, name: str, *, imports: bool = True) -> type[Part]:
    """The class of the part called `name`, see `trexton.base.plugins.resolve`.

    Raises
    ------
    ParameterError
        There is no such role or part.
    """
    check_known(role)
    kind: type[Part] = resolve(role, name, ROLES[role], imports=imports)
    check_role(role, kind)
    return kind


def make(role: str, name: str, **options: object) -> Part:
    """The part called `name` with these options, values or text.

    Raises
    ------
    ParameterError
        A name is unknown or a value does not fit.
    """
    return part_class(role, name).parse(options, f"{role} {name!r}")


def name_of(role: str, part: Part) -> str:
    """The name by which `make` finds the class of a part."""
    address = f"{type(part).__module__}:{type(part).__qualname__}"
    table = ROLES.get(role, {})
    names = table if address in table.values() else addresses(role, table)
    return {where: name for name, where in names.items()}.get(address, address)
