"""A method is made of parts. Offers `Part`, which says what each has: options, needs, what it
learns, arrays in and out."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike

from trexton.base.errors import MapError
from trexton.base.options import Options

Area = tuple[float, float, float, float]  # x_min, x_max, y_min, y_max in metres


def learned() -> Any:
    """Declare an attribute of a part that `Part.fit` sets: an array, stored in the map."""
    return field(init=False, default=None, repr=False)


@dataclass(eq=False)
class Part(Options):
    """One part of a method. Its fields are its options; those made by `learned` are what it learns.

    A subclass is a dataclass that declares its options by `trexton.base.options.option`, and
    overrides `fit` if it learns, `prepare` if it makes something of what it learned, and `check`
    for what no range of a single option can say.

    Attributes
    ----------
    needs : dict of str to type
        Parts that it reads: the role of each, and the class that it must be of.
    uses : tuple of str
        Roles of parts that it reads where a method has them.
    """

    needs: ClassVar[Mapping[str, type[Any]]] = {}
    uses: ClassVar[tuple[str, ...]] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        self.check()

    def check(self) -> None:
        """Raise `ParameterError` for options that do not go together."""

    def prepare(self) -> None:
        """Make what flight needs of the learned arrays, and refuse arrays that fit no flight."""

    @property
    def width(self) -> int | None:
        """Features that a histogram has, of those it learned from; None: any number will do."""
        return None

    def fit(self, training: Any) -> Self:
        """The part as it learned from a `trexton.localization.training_set.Training`; itself where
        there is nothing to learn.
        """
        return self

    def with_learned(self, **arrays: ArrayLike) -> Self:
        """This part with the learned arrays given."""
        fitted = copy.copy(self)
        for name, array in arrays.items():
            setattr(fitted, name, np.asarray(array))
        fitted.prepare()
        return fitted

    def untrained(self) -> Self:
        """The part as it was before it learned anything."""
        return self.with_options()

    def with_options(self, **options: object) -> Self:
        """This part with other options, before it has learned anything."""
        return type(self)(**self.as_dict() | options)

    def arrays(self) -> dict[str, np.ndarray]:
        """What was learned, by name."""
        names = (each.name for each in fields(self) if not each.init)
        return {name: value for name in names if (value := getattr(self, name)) is not None}

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray], **options: object) -> Self:
        """The part that `arrays` and `options` described.

        Raises
        ------
        MapError
            An array is missing, or one too many.
        """
        expected = {each.name for each in fields(cls) if not each.init}
        if set(arrays) != expected:
            raise MapError(
                f"{cls.__name__} learns {sorted(expected)}, found {sorted(arrays)}: copy the map "
                "again or train it anew"
            )
        part = cls(**options)
        return part.with_learned(**arrays) if arrays else part
