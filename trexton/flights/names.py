"""What a flight is called where people read: tables, headings, the book's contents."""

from __future__ import annotations

__all__ = ["flight_title"]

_TITLES = {
    "cyberzoo": "CyberZoo flight (real)",
    "sim-survey": "Virtual hall (simulated)",
    "sim-waypoints": "Virtual hall, an hour later (simulated)",
}


def flight_title(name: str) -> str:
    """A name that a reader can say; flights of a person's own keep the name in their header."""
    return _TITLES.get(name, name)
