"""What a notebook was given: flights, folder of results, parameters. Offers `given`, which reads
them from its names and refuses those that are nearly right.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from difflib import get_close_matches
from functools import cached_property
from pathlib import Path
from typing import Any

from trexton.base.cache import repository_root
from trexton.base.errors import ParameterError
from trexton.base.options import Options
from trexton.companion.build.flight_pairs import load_pair
from trexton.flights import Flight

__all__ = ["Given", "given"]


def _resolve(path: str) -> Path:
    """`path` from here or, for a notebook opened in its own folder, from the top of the clone."""
    here, root = Path(path), repository_root()
    return root / path if root and not here.exists() and (root / path).exists() else here


@dataclass(frozen=True)
class Given:
    """What a notebook was given: flights, folder of results, and the experiment's parameters."""

    flight: str
    test_flight: str | None
    out: str
    parameters: Any

    @cached_property
    def _pair(self) -> tuple[Flight, Flight]:
        test_flight = None if self.test_flight is None else _resolve(self.test_flight)
        return load_pair(_resolve(self.flight), test_flight)

    @property
    def train(self) -> Flight:
        """The training flight: the first folder, of it the split ``train`` where there is one."""
        return self._pair[0]

    @property
    def test(self) -> Flight:
        """The test flight: the second folder, or the split ``test`` of the first."""
        return self._pair[1]


def given(parameters: type[Options], names: Mapping[str, object]) -> Given:
    """Read flights, folder and parameters from the `names` of a notebook (its ``globals()``).

    A parameter that the notebook does not name has its default, which stands in the class alone.

    Raises
    ------
    ParameterError
        A value has the wrong type or is out of its range, or a name is nearly that of a parameter.
    """
    mine = ("flight", "test_flight", "out")
    declared = {each.name for each in parameters.declared()}.union(mine)
    for name, value in names.items():
        near = get_close_matches(name, declared - names.keys(), n=1, cutoff=0.75)
        if near and name not in declared and isinstance(value, (int, float, str)):
            raise ParameterError(
                f"the notebook sets {name} = {value!r}, which is no parameter: write {near[0]}, or "
                "give what is your own a name less like it"
            )
    chosen = {each.name: names[each.name] for each in parameters.declared() if each.name in names}
    flight, test_flight, out = (names.get(name) for name in mine)
    return Given(
        str(flight), None if test_flight is None else str(test_flight), str(out),
        parameters(**chosen),
    )  # fmt: skip
