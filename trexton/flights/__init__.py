"""Flights: images, stamps, positions. One class, its folder on disk, a registry of public data."""
