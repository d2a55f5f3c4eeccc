"""The roles of which a method is made, and the parts of the library by name.

A part of one's own needs no entry: see `trexton.base.plugins`, where a role is a kind.
"""

from __future__ import annotations

from trexton.base.errors import ParameterError
from trexton.base.plugins import addresses, resolve
from trexton.localization.base import Part

__all__ = ["ROLES", "base_class", "check_known", "check_role", "make", "name_of", "part_class"]

# role: {name: where the class is}. Loaded when asked for, so that a heavy part costs nothing where
# it does not fly.
ROLES: dict[str, dict[str, str]] = {
    "distance": {
        "euclidean": "trexton.localization.distances:Euclidean",
        "hellinger": "trexton.localization.distances:Hellinger",
        "chi-square": "trexton.localization.distances:ChiSquare",
    },
    "view": {"nadir": "trexton.localization.view:Nadir"},
    "appearance": {
        "none": "trexton.field.appearance:AsSurveyed",
        "tracked": "trexton.field.appearance:Tracked",
    },
    "odometry": {"visual": "trexton.localization.odometry:Visual"},
    "motion": {
        "random-walk": "trexton.localization.motion:RandomWalk",
        "singer": "trexton.field.singer:Singer",
        "constant-velocity": "trexton.field.constant_velocity:ConstantVelocity",
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
        "wheel": "trexton.localization.resampling:Wheel",
        "systematic": "trexton.localization.resampling:Systematic",
    },
    "estimation": {
        "map": "trexton.localization.estimation:MaximumAPosteriori",
        "mean": "trexton.localization.estimation:WeightedMean",
        "highest-weight": "trexton.localization.estimation:HighestWeight",
    },
    "recovery": {
        "none": "trexton.localization.recovery:NoRecovery",
        "augmented": "trexton.localization.recovery:Augmented",
    },
}


def check_known(role: str) -> None:
    """Raise `ParameterError` unless there is such a role."""
    if role not in ROLES:
        raise ParameterError(f"part {role!r} is unknown: choose one of {', '.join(ROLES)}")


def base_class(role: str) -> type[Part]:
    """The class of which all parts that fill a role are."""
    first = resolve(role, next(iter(ROLES[role])), ROLES[role])
    return next(each for each in first.__mro__ if Part in each.__bases__)


def check_role(role: str, kind: object) -> None:
    """Raise `ParameterError` unless a part of this class fills the role."""
    base = base_class(role)
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
