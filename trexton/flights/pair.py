"""A flight to train on and one to test on: two folders, or two splits of one."""

from __future__ import annotations

from pathlib import Path

from trexton.flights.flight import Flight
from trexton.flights.folder import read_flight

__all__ = ["load_pair"]


def load_pair(flight: str | Path, test_flight: str | Path | None) -> tuple[Flight, Flight]:
    """The training and the test flight.

    Parameters
    ----------
    flight, test_flight : path
        Of two flights their splits ``train`` and ``test`` where they have them, else all frames; of
        one flight (`test_flight` None) its two splits.
    """
    first = read_flight(flight)
    if test_flight is None:
        return first.part("train"), first.part("test")
    second = read_flight(test_flight)
    return (
        first.part("train") if "train" in first.split else first,
        second.part("test") if "test" in second.split else second,
    )
