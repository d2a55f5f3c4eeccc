"""What every part of a method has in common: options, what it learns, arrays in and out."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self, get_type_hints

import numpy as np

from trexton.base.errors import MapError, ParameterError
from trexton.localization.neighbors import NearestHistograms, neighbors_in_flight

if TYPE_CHECKING:
    from trexton.flights.flight import Flight
    from trexton.localization.distances import Distance
    from trexton.localization.texton_map import TextonMap
    from trexton.vision.textons import TextonDictionary

__all__ = ["Area", "Part", "Training", "learned"]

Area = tuple[float, float, float, float]  # x_min, x_max, y_min, y_max in metres


@dataclass(frozen=True, eq=False)
class Training:
    """What parts learn from.

    Attributes
    ----------
    histograms : (N, K) array
        Relative texton frequencies, full sampling.
    positions : (N, 2) array
        Metres.
    time : (N,) array
        Seconds.
    area : (x_min, x_max, y_min, y_max)
    period_s : float
        Median time from frame to frame.
    distance : Distance
        Between histograms, the one that flies.
    dictionary : TextonDictionary or None
        None where the flight came as histograms.
    flight : Flight or None
        The frames themselves, in the same order; None where only their histograms were kept.
    rng : numpy.random.Generator
    texton_map : TextonMap or None
        For calibration and integrity, which judge a method: the map with all other parts trained.
    cells : int
        Parts of the image along each side, each with a histogram of its own.
    """

    histograms: np.ndarray
    positions: np.ndarray
    time: np.ndarray
    area: Area
    period_s: float
    distance: Distance
    dictionary: TextonDictionary | None
    flight: Flight | None
    rng: np.random.Generator
    texton_map: TextonMap | None = None
    cells: int = 1

    @cached_property
    def nearest(self) -> NearestHistograms:
        """The search that flies, over the training set itself."""
        return NearestHistograms(
            self.histograms,
            self.positions,
            k=min(self.texton_map.neighbors if self.texton_map else 1, len(self.histograms)),
            distance=self.distance,
        )

    def neighbors(self, k: int, excluded_s: float) -> np.ndarray:
        """``(N, k)`` rows of the nearest histograms of each frame, those near in time left out.

        Raises
        ------
        MapError
            Some frame has fewer than k others outside the excluded time.
        """
        return neighbors_in_flight(self.nearest, self.histograms, self.time, k, excluded_s)


def learned() -> Any:
    """Declare an attribute of a part that `Part.fit` sets: an array, stored in the map."""
    return field(init=False, default=None, repr=False)


@dataclass(eq=False)
class Part:
    """One part of a method. Its fields are its options; those made by `learned` are what it learns.

    A subclass is a dataclass that overrides `fit` if it learns, `prepare` if it makes something of
    what it learned, and `check` for the ranges of its options.
    """

    def __post_init__(self) -> None:
        self.check()

    def check(self) -> None:
        """Raise `ParameterError` for an option that is out of range."""

    def prepare(self) -> None:
        """Make what flight needs of the learned arrays, and refuse arrays that fit no flight."""

    @property
    def width(self) -> int | None:
        """Features that a histogram has, of those it learned from; None: any number will do."""
        return None

    def fit(self, training: Training) -> Self:
        """The part as it learned from a training set; itself where there is nothing to learn."""
        return self

    def with_learned(self, **arrays: np.ndarray) -> Self:
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
        return type(self)(**self.options() | options)

    def options(self) -> dict[str, Any]:
        """The options by name."""
        return {each.name: getattr(self, each.name) for each in fields(self) if each.init}

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

    @classmethod
    def option(cls, name: str, value: object) -> object:
        """A value for the option `name`, converted from text where it is text.

        Raises
        ------
        ParameterError
            There is no such option, or the value is of another kind.
        """
        known = {each.name for each in fields(cls) if each.init}
        if name not in known:
            offered = ", ".join(sorted(known)) or "none"
            raise ParameterError(f"{cls.__name__} has no option {name!r}: it has {offered}")
        kind = get_type_hints(cls)[name]
        return converted(value, kind, f"option {name!r} of {cls.__name__}")


def converted(value: object, kind: Any, what: str) -> object:
    """`value` as the kind that an annotation such as ``int`` or ``float | None`` asks for."""
    kinds = getattr(kind, "__args__", (kind,))
    if value is None or value == "none":
        if type(None) in kinds:
            return None
    for each in kinds:
        if isinstance(value, bool) and each is not bool:
            continue
        if each is not float and isinstance(each, type) and isinstance(value, each):
            return value
        try:
            if each is float and isinstance(value, (str, int, float)):
                return float(value)
            if each is int and isinstance(value, (str, np.integer)):
                return int(value)
        except ValueError:
            continue
        if each is bool and value in ("true", "false"):
            return value == "true"
    words = {type(None): "none", bool: "true or false"}  # as they are written in a command
    names = " or ".join(words.get(each, each.__name__) for each in kinds)
    raise ParameterError(f"{what} is {value!r}: expected {names}")
