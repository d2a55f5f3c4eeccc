"""Flights as steps: floors of a sweep, the book's simulated pair and the authors' real flight.

Offers `flight_step` and `simulate`, and `prepare_flights`, which has the book's ready.
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

__all__ = ["PATTERNS", "Prepared", "flight_step", "prepare_flights", "simulate"]

PATTERNS = ("survey", "waypoints")  # of a training and a test flight
_REAL = "cyberzoo"


def flight_step(path: Path, inputs: Entries, make: Callable[[], object]) -> Step:
    """The step that makes the flight at `path`, unless it is whole and of the same inputs."""

    def read() -> Entries | None:
        try:
            return {path.name: read_flight(path).data_hash}
        except (OSError, ValueError, FlightError):
            return None

    return Step(path.name, inputs, make, [Fact(f"flight {path.name}", read)])


def simulation_inputs(**options: object) -> Entries:
    """What goes into `simulate`."""
    return inputs_of(options, code_hashes("trexton.simulator"), {})


def simulate(
    path: str,
    pattern: str,
    layout: str = "hall",
    seed: int = 0,
    every: int = 1,
    frames: int | None = None,
) -> None:
    """Record one flight over a painted floor."""
    from trexton.simulator import Floor, record_flight

    floor = Floor.painted(layout, seed)
    record_flight(path, pattern=pattern, floor=floor, every=every, frames=frames, replace=True)


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
    simulated, real, prepared = [folder / f"sim-{p}" for p in PATTERNS], folder / _REAL, Prepared()

    def fetch_real() -> None:
        try:
            fetch(_REAL, real, replace=True)
        except DataError as error:
            prepared.absent[_REAL] = str(error)
            raise

    steps = [
        flight_step(path, simulation_inputs(pattern=p), partial(_say_and_simulate, path, p))
        for path, p in zip(simulated, PATTERNS, strict=True)
    ]
    code = labelled("module", code_hashes("trexton.flights.cyberzoo"))
    files = labelled("file", {key: canonical_json(one) for key, one in raw_files(_REAL).items()})
    steps.append(flight_step(real, code | files, fetch_real))
    if quick:
        real_only = build(steps[-1:], folder / ".engine", 1, lambda: None, Display())
        if real_only[_REAL].good:
            steps = steps[-1:]
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
    if len(steps) > 1:
        prepared.pairs.append(FlightPair(*map(str, simulated)))
    if not prepared.absent:
        prepared.pairs.append(FlightPair(str(real)))
    return prepared


def _say_and_simulate(path: Path, pattern: str) -> None:
    say(f"simulating {path}")
    simulate(str(path), pattern)
