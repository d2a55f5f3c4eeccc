"""GeoJSON: the track as a line, in degrees on Earth where the flight says where its origin lies,
else in metres of the map's own axes.
"""

from __future__ import annotations

import json
from typing import IO

import numpy as np

from trexton.flights.exporters import Trajectory

__all__ = ["write"]


def write(track: Trajectory, stream: IO[str]) -> None:
    """One feature: a LineString, or a Point where there is only one position."""
    places, unit = _on_earth(track), "deg"
    if places is None:
        places, unit = np.round(track.position, 6), "m"
    coordinates = places.tolist()
    properties = {
        "name": track.name,
        "t_s": [float(time) for time in track.time],
        "unit": unit,
    }
    if unit == "deg":
        properties["height_m"] = np.round(track.position[:, 2], 3).tolist()
    feature = {
        "type": "Feature",
        "properties": properties,
        "geometry": {
            "type": "LineString" if len(coordinates) > 1 else "Point",
            "coordinates": coordinates if len(coordinates) > 1 else (coordinates or [[]])[0],
        },
    }
    json.dump({"type": "FeatureCollection", "features": [feature]}, stream)
    stream.write("\n")


def _on_earth(track: Trajectory) -> np.ndarray | None:
    """``(N, 2)`` longitude and latitude to a centimetre; None where nobody knows the origin."""
    if track.origin is None:
        return None
    from trexton.flights.earth import plane

    x, y = track.position[:, :2].T
    return np.round(np.column_stack(plane(track.origin)(x, y, inverse=True)), 7)
