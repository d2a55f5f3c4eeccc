"""What a method is made of: one role a file, each part a small class, found by name here.

A part of one's own needs no entry: ``"package.module:Class"`` names it as well, and so does an
entry point of an installed package in the group ``trexton.<role>``.
"""

from __future__ import annotations

from importlib import import_module

from trexton.base.errors import ParameterError
from trexton.base.plugins import address_of, names, resolve
from trexton.localization.base import Part

__all__ = ["ROLES", "check_known", "check_role", "make", "name_of", "part_class"]

# role: {name: where the class is}. Loaded when asked for, so that a heavy part costs nothing where
# it does not fly.
ROLES: dict[str, dict[str, str]] = {
    "distance": {
        "euclidean": "trexton.localization.distances:Euclidean",
        "hellinger": "trexton.localization.distances:Hellinger",
        "chi-square": "trexton.localization.distances:ChiSquare",
    },
    "view": {
        "nadir": "trexton.localization.view:Nadir",
    },
    "odometry": {
        "visual": "trexton.localization.odometry:Visual",
    },
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
    "calibration": {
        "none": "trexton.localization.calibration:NoCalibration",
        "replay": "trexton.localization.calibration:Replay",
    },
    "integrity": {
        "none": "trexton.field.integrity:NoIntegrity",
        "elsewhere": "trexton.field.integrity:Elsewhere",
    },
}


def check_known(role: str) -> None:
    """Raise `ParameterError` unless there is such a role."""
    if role not in ROLES:
        raise ParameterError(f"part {role!r} is unknown: choose one of {', '.join(ROLES)}")


def check_role(role: str, kind: type[Part]) -> None:
    """Raise `ParameterError` unless a part of this class fills the role."""
    module, _, attribute = next(iter(ROLES[role].values())).partition(":")
    first = getattr(import_module(module), attribute)
    base = next(each for each in first.__mro__ if Part in each.__bases__)  # of all that fill it
    if not issubclass(kind, base) or kind is base:
        raise ParameterError(
            f"{role} is a {kind.__module__}:{kind.__qualname__}: expected a subclass of "
            f"{base.__module__}.{base.__qualname__}"
        )


def part_class(role: str, name: str, *, imports: bool = True) -> type[Part]:
    """The class of the part called `name`, an entry of `ROLES` or ``"module:Class"``.

    Without `imports` a module that is neither in the table nor imported already is refused: what
    a file says must not decide which code runs.

    Raises
    ------
    ParameterError
        There is no such role or part.
    """
    check_known(role)
    kind = resolve(role, name, ROLES[role], imports=imports)
    if not (isinstance(kind, type) and issubclass(kind, Part)):
        offered = ", ".join(names(role, ROLES[role]))
        raise ParameterError(
            f"{role} {name!r} is no part: choose one of {offered}, or module:Class"
        )
    check_role(role, kind)
    return kind


def make(role: str, name: str, **options: object) -> Part:
    """The part called `name` with these options; text is converted to what an option takes.

    Raises
    ------
    ParameterError
        A name is unknown or a value does not fit.
    """
    kind = part_class(role, name)
    return kind(**{key: kind.option(key, value) for key, value in options.items()})


def name_of(role: str, part: Part) -> str:
    """The name by which `make` finds the class of a part."""
    address = f"{type(part).__module__}:{type(part).__qualname__}"
    for name in names(role, ROLES.get(role, {})):
        if address_of(role, name, ROLES.get(role, {})) == address:
            return name
    return address
