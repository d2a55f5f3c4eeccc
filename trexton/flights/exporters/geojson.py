"""GeoJSON: the track as a line, in metres of the map's own axes (no place on Earth is claimed)."""

from __future__ import annotations

import json
from typing import IO

from trexton.flights.exporters import Trajectory

__all__ = ["write"]


def write(track: Trajectory, stream: IO[str]) -> None:
    """One feature: a LineString, or a Point where there is only one position."""
    places = [[round(float(value), 6) for value in place] for place in track.position]
    kind = "LineString" if len(places) > 1 else "Point"
    feature = {
        "type": "Feature",
        "properties": {
            "name": track.name,
            "t_s": [float(time) for time in track.time],
            "unit": "m",
        },
        "geometry": {
            "type": kind,
            "coordinates": places if len(places) > 1 else (places or [[]])[0],
        },
    }
    json.dump({"type": "FeatureCollection", "features": [feature]}, stream)
    stream.write("\n")
