"""Flights: images, stamps, positions. One class, its folder on disk, a registry of public data.

What reads and writes folders is imported on first use: what is flown needs none of it.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from trexton.flights.flight import Flight
    from trexton.flights.folder import read_flight
    from trexton.flights.writing import write_flight

__all__ = ["Flight", "read_flight", "write_flight"]

_PLACES = {"Flight": "flight", "read_flight": "folder", "write_flight": "writing"}


def __getattr__(name: str) -> Any:
    if name not in _PLACES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_PLACES[name]}"), name)
