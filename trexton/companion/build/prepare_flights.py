"""The flights that the book is made from: the authors' real one, and the simulated pair."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from trexton.base.cache import code_hashes
from trexton.base.errors import DataError, FlightError
from trexton.base.files import atomic_file, canonical_json
from trexton.base.progress import say
from trexton.base.records import software_versions
from trexton.companion.build.flight_pairs import FlightPair
from trexton.flights import Flight, read_flight
from trexton.flights.registry import fetch, raw_files

__all__ = ["REAL", "SIMULATED", "Prepared", "prepare_flights"]

SIMULATED = ("sim-survey", "sim-waypoints")
REAL = "cyberzoo"
_PATTERN = dict(zip(SIMULATED, ("survey", "waypoints"), strict=True))


class Prepared:
    """Flights that are ready, and sentences on what was made, reused or missing."""

    def __init__(self) -> None:
        self.pairs: list[FlightPair] = []
        self.absent: dict[str, str] = {}
        self.said: list[str] = []


def prepare_flights(folder: Path) -> Prepared:
    """Make sure that the simulated pair and, if it can be had, the real flight are in `folder`."""
    prepared = Prepared()
    for name in SIMULATED:
        _prepare(folder / name, _simulation_inputs(name), lambda path: _simulate(path), prepared)
    prepared.pairs.append(FlightPair(*(str(folder / name) for name in SIMULATED)))
    try:
        _prepare(
            folder / REAL, _real_inputs(), lambda path: fetch(REAL, path, replace=True), prepared
        )
        prepared.pairs.append(FlightPair(str(folder / REAL)))
    except DataError as error:
        prepared.absent[REAL] = str(error)
        prepared.said.append(f"flight {REAL}: absent, the book goes without it: {error}")
    return prepared


def _simulate(path: Path) -> None:
    from trexton.simulator import record_flight

    say(f"simulating {path}")
    record_flight(path, pattern=_PATTERN[path.name], replace=True)


def _simulation_inputs(name: str) -> dict[str, Any]:
    return {
        "code": code_hashes("trexton.simulator"),
        "pattern": _PATTERN[name],
        "versions": software_versions(),
    }


def _real_inputs() -> dict[str, Any]:
    return {"code": code_hashes("trexton.flights.cyberzoo"), "files": raw_files(REAL)}


def _prepare(
    path: Path, inputs: dict[str, Any], make: Callable[[Path], object], prepared: Prepared
) -> None:
    """Keep the flight at `path` if whole and of the same inputs, make it otherwise."""
    stamp = path.parent / f".{path.name}.stamp"
    reason = _reason_to_make(path, stamp, inputs)
    if reason is None:
        prepared.said.append(f"flight {path.name}: reused")
        return
    stamp.unlink(missing_ok=True)
    make(path)
    with atomic_file(stamp) as stream:
        stream.write(canonical_json({"inputs": inputs, "data_hash": read_flight(path).data_hash}))
    prepared.said.append(f"flight {path.name}: made, because {reason}")


def _reason_to_make(path: Path, stamp: Path, inputs: dict[str, Any]) -> str | None:
    try:
        old = json.loads(stamp.read_text(encoding="utf-8"))
        flight: Flight = read_flight(path)
    except (OSError, ValueError, FlightError):
        return "it was not there whole"
    if old.get("inputs") != inputs:
        return "what makes it changed"
    return (
        None if old.get("data_hash") == flight.data_hash else "its files are not what was written"
    )
