"""The book's flights as steps: the simulated pair and the authors' real flight.

Offers `prepare_flights`, which has them ready.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from trexton.base.cache import code_hashes
from trexton.base.errors import DataError, FlightError, TrextonError
from trexton.base.files import canonical_json
from trexton.base.progress import say
from trexton.companion.build.display import Display
from trexton.companion.build.engine import Entries, Fact, Step, build, labelled
from trexton.companion.build.flight_pairs import FlightPair
from trexton.companion.build.notebooks import inputs_of
from trexton.flights import read_flight
from trexton.flights.registry import fetch, raw_files

__all__ = ["Prepared", "prepare_flights"]

_PATTERNS = ("survey", "waypoints")  # of a training and a test flight
_REAL = "cyberzoo"


@dataclass
class Prepared:
    """Flights that are ready, sentences on what was made or reused, and why one is absent."""

    pairs: list[FlightPair] = field(default_factory=list)
    absent: dict[str, str] = field(default_factory=dict)
    said: list[str] = field(default_factory=list)


def prepare_flights(folder: Path, quick: bool = False) -> Prepared:
    """Make sure that the simulated pair and, if it can be had, the real flight are in `folder`.

    With `quick` the real flight alone, which needs no simulation, unless it cannot be had.

    Raises
    ------
    TrextonError
        A flight could not be made, for another reason than that it cannot be fetched.
    """
    simulated, real, prepared = [folder / f"sim-{p}" for p in _PATTERNS], folder / _REAL, Prepared()

    def fetch_real() -> None:
        try:
            fetch(_REAL, real, replace=True)
        except DataError as error:
            prepared.absent[_REAL] = str(error)
            raise

    code = labelled("module", code_hashes("trexton.flights.cyberzoo"))
    files = labelled("file", {key: canonical_json(one) for key, one in raw_files(_REAL).items()})
    _make([_step(real, code | files, fetch_real)], folder, prepared)
    if not (quick and not prepared.absent):
        steps = [
            _step(
                path, inputs_of({"pattern": pattern}, code_hashes("trexton.simulator"), {}),
                partial(_simulate, path, pattern),
            )
            for path, pattern in zip(simulated, _PATTERNS, strict=True)
        ]  # fmt: skip
        _make(steps, folder, prepared)
        prepared.pairs.append(FlightPair(*map(str, simulated)))
    if not prepared.absent:
        prepared.pairs.append(FlightPair(str(real)))
    return prepared


def _step(path: Path, inputs: Entries, make: Callable[[], object]) -> Step:
    """The step that makes the flight at `path`, unless it is whole and of the same inputs."""

    def read() -> Entries | None:
        try:
            return {path.name: read_flight(path).data_hash}
        except (OSError, ValueError, FlightError):
            return None

    return Step(path.name, inputs, make, [Fact(f"flight {path.name}", read)])


def _simulate(path: Path, pattern: str) -> None:
    from trexton.simulator import record_flight

    say(f"simulating {path}")
    record_flight(path, pattern=pattern, replace=True)


def _make(steps: list[Step], folder: Path, prepared: Prepared) -> None:
    """Bring flights up to date, and note what became of each."""
    outcomes = build(steps, folder / ".engine", 1, lambda: None, Display())
    for name in (step.name for step in steps):
        one = outcomes[name]
        if name in prepared.absent:
            why = f"absent, the book goes without it: {prepared.absent[name]}"
        elif not one.good:
            raise TrextonError(one.reasons[0])
        else:
            why = one.status if one.status == "reused" else f"made, because {one.reasons[0]}"
        prepared.said.append(f"flight {name}: {why}")
