"""What a process does for a sweep: fly over one floor, or run one experiment. Light to import."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from trexton.base.files import canonical_json

if TYPE_CHECKING:
    from trexton.base.records import Record

__all__ = ["measure", "record"]


def record(path: str, pattern: str, layout: str, seed: int, every: int, frames: int | None) -> None:
    """Record one flight over a painted floor."""
    from trexton.simulator import Floor, record_flight

    floor = Floor.painted(layout, seed)
    record_flight(path, pattern=pattern, floor=floor, every=every, frames=frames)


def measure(module: str, flight: str, test_flight: str | None, parameters: dict[str, Any]) -> str:
    """Run one experiment; the record without series and pictures, as JSON text."""
    from trexton.flights.splits import load_pair

    experiment = import_module(module)
    train, test = load_pair(flight, test_flight)
    result: Record = experiment.run(train, test, experiment.Parameters(**parameters))
    kept = ("experiment", "flight", "parameters", "values", "timings", "provenance")
    return canonical_json({name: getattr(result, name) for name in kept})
