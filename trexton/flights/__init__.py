"""Flights: images, stamps, positions. One class, a reader or writer for each format, a registry of public data."""

from trexton.flights.flight import Flight
from trexton.flights.folder import read_flight, write_flight

__all__ = ["Flight", "read_flight", "write_flight"]
