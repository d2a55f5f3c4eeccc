"""Flights: images, stamps, positions. One class, its folder on disk, a registry of public data."""

from trexton.flights.flight import Flight
from trexton.flights.folder import read_flight
from trexton.flights.writing import write_flight

__all__ = ["Flight", "read_flight", "write_flight"]
