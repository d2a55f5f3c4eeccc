"""Tracks of flights and of records in the formats that others read: a function each.

An exporter takes a `Flight`, all of whose frames have a position, and a stream of text. It is a
line in `EXPORTERS`, an entry point or ``module:function``; `load_trajectory` gives the track,
`export` writes it.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import IO

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.files import atomic_file, read_text
from trexton.base.plugins import resolve
from trexton.flights.flight import Flight, area_around
from trexton.flights.folder import read_flight
from trexton.flights.geodesy import plane

__all__ = ["EXPORTERS", "export", "load_trajectory"]

EXPORTERS = {kind: f"trexton.flights.exporters:write_{kind}" for kind in ("tum", "csv", "geojson")}


def load_trajectory(source: Path, what: str = "truth") -> Flight:
    """The track in a Flight folder, or a track in a record of an experiment: ``truth``, and
    ``estimate``, ``knn`` or the name of a method.

    Frames without a position are left out.

    Raises
    ------
    FlightError
        The source is neither, or has no such track.
    """
    if source.is_dir():
        if what != "truth":
            raise FlightError(f"{source}: a flight has no {what}: give the record of an experiment")
        flight = read_flight(source)
        return flight.select(flight.located)
    try:
        record = json.loads(read_text(source))
        series = record["series"]
        time = np.array(series["time_s"], dtype=float) + float(series.get("start_s", 0.0))
        position = np.array(series.get(f"{what}_m", []), dtype=float)
        if position.shape != (len(time), 2):
            whole = [key[:-2] for key in series if key.endswith("_m") and _fits(series[key], time)]
            raise ValueError(f"it has {', '.join(whole) or 'none'}")
        height = np.full(len(time), float(series.get("height_m", 0.0)))
        if not (np.isfinite(time).all() and np.isfinite(height).all()):
            raise ValueError("a stamp or its height is no number")
        if origin := series.get("origin_deg"):
            latitude, longitude = origin
            if not (abs(latitude) <= 90 and abs(longitude) <= 180):
                raise ValueError(f"its origin is {latitude}, {longitude} degrees")
        flight = Flight(
            f"{record['flight']} {what}", np.arange(len(time)), time, position,
            area_around(position), height=height, origin=tuple(origin) if origin else None,
        )  # fmt: skip
    except (ValueError, KeyError, TypeError) as error:
        raise FlightError(
            f"{source}: no record with a track of {what} ({error}): give mocap_training.json or "
            "a flight"
        ) from None
    return flight.select(flight.located)


def _fits(values: object, time: np.ndarray) -> bool:
    """Whether a series has a place for each stamp."""
    return isinstance(values, list) and len(values) == len(time) > 0 and np.shape(values[0]) == (2,)


def _poses(flight: Flight) -> np.ndarray:
    """``(N, 4)`` x, y, z in metres and yaw in radians; z and yaw are 0 where they are not known."""
    unknown = np.zeros(len(flight))
    height = unknown if flight.height is None else flight.height
    yaw = unknown if flight.attitude is None else flight.attitude[:, 2]
    return np.column_stack([flight.position, np.nan_to_num(np.column_stack([height, yaw]))])


def write_csv(flight: Flight, stream: IO[str]) -> None:
    """CSV: ``t_s,x_m,y_m,z_m,yaw_rad`` with all digits."""
    stream.write("t_s,x_m,y_m,z_m,yaw_rad\n")
    for row in np.column_stack([flight.time, _poses(flight)]).tolist():
        stream.write(",".join(map(repr, row)) + "\n")


def write_tum(flight: Flight, stream: IO[str]) -> None:
    """TUM: ``stamp x y z qx qy qz qw``, seconds and metres, as evo reads it; the quaternion turns a
    vehicle whose x points forward (REP 103).
    """
    for time, (*place, yaw) in zip(flight.time, _poses(flight), strict=True):
        half = (yaw + np.pi / 2) / 2  # a vehicle of yaw 0 flies along y (`trexton.vision.camera`)
        numbers = (time, *place, 0.0, 0.0, np.sin(half), np.cos(half))
        stream.write(" ".join(f"{number:.9f}" for number in numbers) + "\n")


def write_geojson(flight: Flight, stream: IO[str]) -> None:
    """GeoJSON: a line (a point where there is only one position), in degrees on Earth to a
    centimetre where the flight says where its origin lies, else in metres of the map's own axes.
    """
    properties = {"name": flight.name, "t_s": flight.time.tolist(), "unit": "m"}
    places = np.round(_poses(flight)[:, :3], 6)
    if flight.origin is not None:
        properties |= {"unit": "deg", "height_m": np.round(places[:, 2], 3).tolist()}
        x, y = flight.position.T
        places = np.round(np.column_stack(plane(flight.origin)(x, y, inverse=True)), 7)
    coordinates = places.tolist()
    line = len(coordinates) > 1
    geometry = {
        "type": "LineString" if line else "Point",
        "coordinates": coordinates if line else (coordinates or [[]])[0],
    }
    feature = {"type": "Feature", "properties": properties, "geometry": geometry}
    json.dump({"type": "FeatureCollection", "features": [feature]}, stream)
    stream.write("\n")


def export(flight: Flight, kind: str, path: Path) -> Path:
    """Write the track as `kind`, an entry of `EXPORTERS`, an entry point in the group
    ``trexton.exporters`` or ``module:function``; whole or not at all.

    Raises
    ------
    ParameterError
        There is no such kind.
    """
    write = resolve("exporters", kind, EXPORTERS)
    with atomic_file(path) as stream:
        write(flight, stream)
    return path
