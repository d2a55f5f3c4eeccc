"""Options declared once: a frozen dataclass whose fields say type, default, range and meaning.

The command line, the checks, the documentation and the record of whatever has options are made from
the dataclass (`trexton.base.arguments`)::

    @dataclass(frozen=True)
    class Parameters(Options):
        particles: int = option(50, "particles of the filter", low=1)

    Parameters(particles=0)  # ParameterError: particles is 0: expected 1 or more
    Parameters.parse({"particles": "80"})  # text, as typed after --set particles=
"""

from __future__ import annotations

import ast
import math
import operator
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields, is_dataclass
from types import NoneType
from typing import Any, ClassVar, Self, SupportsIndex, TypeVar, get_args, get_type_hints

import numpy as np

from trexton.base.errors import ParameterError

T = TypeVar("T")
_WORDS = {"true": True, "false": False, "none": None}
_ANSWERS = {"yes": True, "no": False}


def option(
    default: T,
    meaning: str,
    *,
    low: float | None = None,
    high: float | None = None,
    above: float | None = None,
    choices: Sequence[str] = (),
) -> T:
    """A field of an `Options` class, or an option of a part.

    Parameters
    ----------
    default : object
        The only place where the default stands.
    meaning : str
        One line for people, without a full stop.
    low, high : float, optional
        Smallest and largest value allowed.
    above : float, optional
        What it must exceed.
    choices : sequence of str
        The words allowed, where not every text is.
    """
    limits = {"low": low, "high": high, "above": above, "choices": tuple(choices)}
    return field(default=default, metadata={"meaning": meaning, **limits})


def whole(value: object, what: str, low: int = 1, high: int | None = None) -> int:
    """A count as an int, NumPy's integers among them.

    Raises `ParameterError`, in which `what` names it, where it is no whole number or below `low` or
    above `high`.
    """
    if isinstance(value, SupportsIndex) and not isinstance(value, bool):
        number = value.__index__()
        if low <= number and (high is None or number <= high):
            return number
    span = f"of at least {low}" if high is None else f"from {low} to {high}"
    raise ParameterError(f"{what} is {value!r}: expected a whole number {span}")


def number(
    value: object,
    what: str,
    *,
    low: float | None = None,
    high: float | None = None,
    above: float | None = None,
) -> float:
    """A finite float in a range as of `option`; raises `ParameterError`, which says `what`."""
    try:
        checked: Any = Option(what, (float,), 1.0, "", low, high, above).check(value)
    except ParameterError as error:
        raise ParameterError(str(error).removeprefix("parameter ")) from None
    return float(checked)


@dataclass(frozen=True)
class Option:
    """One declared option: its name, the types it may have, its default, its meaning and range."""

    name: str
    types: tuple[type, ...]
    default: object
    meaning: str = ""
    low: float | None = None
    high: float | None = None
    above: float | None = None
    choices: tuple[str, ...] = ()

    def parse(self, text: str) -> object:
        """The value that `text` stands for, checked; raises `ParameterError`."""
        if self.types == (str,):
            return self.check(text)
        value: object = text
        words = _WORDS | (_ANSWERS if bool in self.types else {})
        with suppress(ValueError, SyntaxError):
            value = words[text.lower()] if text.lower() in words else ast.literal_eval(text)
        if str in self.types and type(value) not in self.types:
            value = text  # "2.5,2.5" is a tuple to Python, and text to whom text is enough
        return self.check(value)

    def check(self, value: object) -> object:
        """`value` if type and range fit (an int also stands for a float); else `ParameterError`."""
        if isinstance(value, np.generic):
            value = value.item()
        if type(value) is int and float in self.types and int not in self.types:
            value = float(value)
        if type(value) not in self.types:
            kinds = self.types_as_text()
            raise self._refusal(value, f"{kinds}, as in {self.name}={self.default!r}")
        if isinstance(value, float) and not math.isfinite(value):
            raise self._refusal(value, "a finite number")
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            for words, bound, holds in (
                ("{:g} or more", self.low, operator.ge),
                ("{:g} or less", self.high, operator.le),
                ("more than {:g}", self.above, operator.gt),
            ):
                if bound is not None and not holds(value, bound):
                    raise self._refusal(value, words.format(bound))
        if self.choices and value is not None and value not in self.choices:
            raise self._refusal(value, f"one of {', '.join(self.choices)}")
        return value

    def _refusal(self, value: object, expected: str) -> ParameterError:
        return ParameterError(f"parameter {self.name} is {value!r}: expected {expected}")

    def types_as_text(self) -> str:
        """``float or None``, for people."""
        return " or ".join("None" if kind is NoneType else kind.__name__ for kind in self.types)

    def __str__(self) -> str:
        """One line of help: name, default, types, range and meaning."""
        bounds = {">=": self.low, ">": self.above, "<=": self.high}
        ends = [f"{sign} {bound:g}" for sign, bound in bounds.items() if bound is not None]
        kinds = ", ".join(self.choices) or " ".join([self.types_as_text(), *ends])
        return f"{self.name}={self.default} ({kinds}): {self.meaning}".removesuffix(": ")


class Options:
    """Base of dataclasses whose fields are options; every object of it has been checked.

    Fields that are not arguments (``init=False``) are no options.

    The first line of a class's docstring names its group on the command line.

    Attributes
    ----------
    prefix : str
        Goes before the options there, where others could have the same name:
        ``--PREFIX-OPTION``.
    """

    prefix: ClassVar[str] = ""

    def __post_init__(self) -> None:
        for each in self.declared():
            object.__setattr__(self, each.name, each.check(getattr(self, each.name)))

    @classmethod
    def declared(cls) -> Iterator[Option]:
        """What is declared, in the order of the class."""
        if not is_dataclass(cls):
            return
        own = [each for each in fields(cls) if each.init]
        hints = get_type_hints(cls) if own else {}
        for each in own:
            kinds = get_args(hints[each.name]) or (hints[each.name],)
            yield Option(each.name, kinds, each.default, **each.metadata)

    @classmethod
    def flag(cls, name: str) -> str:
        """The word of the command line that sets an option."""
        return "--" + "-".join(filter(None, (cls.prefix, name.replace("_", "-"))))

    @classmethod
    def checked(cls, settings: Mapping[str, object], owner: str = "this") -> dict[str, Any]:
        """`settings`, values or text as a person typed it, as checked values.

        Raises
        ------
        ParameterError
            A name is unknown (the message lists those of `owner`), a type or a range does not fit.
        """
        options = {each.name: each for each in cls.declared()}
        for name in settings:
            if name not in options:
                names = ", ".join(options) or "none"
                raise ParameterError(f"{owner} has no parameter {name!r}: it has {names}")
        return {
            name: options[name].parse(value)
            if isinstance(value, str)
            else options[name].check(value)
            for name, value in settings.items()
        }

    @classmethod
    def parse(cls, settings: Mapping[str, object], owner: str = "this") -> Self:
        """Defaults with `settings` in their place; see `checked`."""
        return cls(**cls.checked(settings, owner))

    def as_dict(self) -> dict[str, Any]:
        """Names and values, in the order of the class."""
        return {each.name: getattr(self, each.name) for each in self.declared()}
