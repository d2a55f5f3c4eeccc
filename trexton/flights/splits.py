"""Training and test set: of two flights, or of two splits of one.

`load_pair` reads both, `with_splits` divides a flight that has no splits of its own.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from trexton.base.errors import FlightError
from trexton.flights.flight import Flight
from trexton.flights.folder import read_flight

__all__ = ["load_pair", "with_splits"]

_SHARE = 0.6  # of the positions of a flight without splits is for training


def load_pair(flight: str | Path, test_flight: str | Path | None) -> tuple[Flight, Flight]:
    """The training and the test flight.

    Parameters
    ----------
    flight, test_flight : path
        Of two flights their splits ``train`` and ``test`` where they have them, else all frames; of
        one flight (`test_flight` None) its two splits (`with_splits`).

    Raises
    ------
    FlightError
        A folder is no flight, or fewer than three frames of the test have a position.
    """
    first = read_flight(flight)
    if test_flight is None:
        first = with_splits(first)
        train, test = first.part("train"), first.part("test")
    else:
        second = read_flight(test_flight)
        train = first.part_or_all("train")
        test = second.part_or_all("test")
    located = int(test.located.sum())
    if located < 3:
        raise FlightError(
            f"flight {test.name!r} has {located} frames with a position to test on: "
            "a test needs at least 3"
        )
    return train, test


def with_splits(flight: Flight) -> Flight:
    """The flight with splits ``train`` and ``test``: its own if it has both.

    Otherwise training ends with the frame that has three fifths of the positions behind it, and the
    test is what follows.
    """
    if {"train", "test"} <= set(flight.split) or len(flight) < 2:
        return flight
    located = np.flatnonzero(flight.located)
    rows = located if len(located) > 1 else np.arange(len(flight))
    last = int(rows[min(max(1, round(_SHARE * len(rows))), len(rows) - 1) - 1])
    numbers = flight.frame
    train, test = (numbers[0], numbers[last]), (numbers[last + 1], numbers[-1])
    return replace(
        flight,
        split={"train": (int(train[0]), int(train[1])), "test": (int(test[0]), int(test[1]))},
    )
