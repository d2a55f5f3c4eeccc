"""Tracks of flights and of records in the formats that others read: a function each.

An exporter takes a `Trajectory` and a stream of text, and is a line in `EXPORTERS`, an entry point
or ``module:function``; `load_trajectory` gives the track, `export` writes it.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO

import numpy as np

from trexton.base.errors import FlightError
from trexton.base.files import atomic_file
from trexton.base.plugins import resolve
from trexton.flights.folder import read_flight
from trexton.flights.geodesy import plane
from trexton.flights.tables import read_text

__all__ = ["EXPORTERS", "Trajectory", "export", "load_trajectory"]

EXPORTERS = {
    "tum": "trexton.flights.exporters:write_tum",
    "csv": "trexton.flights.exporters:write_csv",
    "geojson": "trexton.flights.exporters:write_geojson",
}


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A row of positions.

    Attributes
    ----------
    name : str
    time : (N,) array
        Seconds.
    position : (N, 3) array
        Metres, z of the floor plane (0) where no height is known.
    yaw : (N,) array
        Radians; 0 where no heading is known.
    origin : (latitude, longitude) or None
        Degrees of the place from which x counts metres east and y metres north, where known.
    """

    name: str
    time: np.ndarray
    position: np.ndarray
    yaw: np.ndarray
    origin: tuple[float, float] | None = None


def load_trajectory(source: Path, what: str = "truth") -> Trajectory:
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
        height = np.zeros(len(flight)) if flight.height is None else flight.height
        yaw = np.zeros(len(flight)) if flight.attitude is None else flight.attitude[:, 2]
        track = _known(flight.name, flight.time, flight.position, height, yaw)
        return replace(track, origin=flight.origin)
    try:
        record = json.loads(read_text(source))
        series, name = record["series"], record["flight"]
        time = np.array(series["time_s"], dtype=float) + float(series.get("start_s", 0.0))
        position = np.array(series.get(f"{what}_m", []), dtype=float)
        if position.shape != (len(time), 2):
            whole = [key[:-2] for key in series if key.endswith("_m") and _fits(series[key], time)]
            raise ValueError(f"it has {', '.join(whole) or 'none'}")
        height = np.full(len(time), float(series.get("height_m", 0.0)))
        if not (np.isfinite(time).all() and np.isfinite(height).all()):
            raise ValueError("a stamp or its height is no number")
        latitude, longitude = series.get("origin_deg", (None, None))
        if latitude is not None and not (abs(latitude) <= 90 and abs(longitude) <= 180):
            raise ValueError(f"its origin is {latitude}, {longitude} degrees")
    except (ValueError, KeyError, TypeError) as error:
        raise FlightError(
            f"{source}: no record with a track of {what} ({error}): give mocap_training.json or "
            "a flight"
        ) from None
    track = _known(f"{name} {what}", time, position, height, np.zeros(len(time)))
    return track if latitude is None else replace(track, origin=(latitude, longitude))


def _fits(values: object, time: np.ndarray) -> bool:
    """Whether a series has a place for each stamp."""
    return isinstance(values, list) and len(values) == len(time) > 0 and np.shape(values[0]) == (2,)


def _known(
    name: str, time: np.ndarray, position: np.ndarray, height: np.ndarray, yaw: np.ndarray
) -> Trajectory:
    rows = np.isfinite(position).all(axis=1)
    place = np.column_stack([position, np.where(np.isfinite(height), height, 0.0)])
    return Trajectory(name, time[rows], place[rows], np.where(np.isfinite(yaw), yaw, 0.0)[rows])


def write_csv(track: Trajectory, stream: IO[str]) -> None:
    """CSV: ``t_s,x_m,y_m,z_m,yaw_rad`` with all digits."""
    stream.write("t_s,x_m,y_m,z_m,yaw_rad\n")
    for row in np.column_stack([track.time, track.position, track.yaw]).tolist():
        stream.write(",".join(map(repr, row)) + "\n")


def write_tum(track: Trajectory, stream: IO[str]) -> None:
    """TUM: ``stamp x y z qx qy qz qw``, seconds and metres, as evo reads it; the quaternion turns a
    vehicle whose x points forward (REP 103).
    """
    # A vehicle of yaw 0 flies along y (`trexton.vision.camera`).
    for time, place, yaw in zip(track.time, track.position, track.yaw + np.pi / 2, strict=True):
        numbers = (time, *place, 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2))
        stream.write(" ".join(f"{number:.9f}" for number in numbers) + "\n")


def write_geojson(track: Trajectory, stream: IO[str]) -> None:
    """GeoJSON: a line (a point where there is only one position), in degrees on Earth to a
    centimetre where the flight says where its origin lies, else in metres of the map's own axes.
    """
    properties = {"name": track.name, "t_s": track.time.tolist(), "unit": "m"}
    places = np.round(track.position, 6)
    if track.origin is not None:
        x, y = track.position[:, :2].T
        places = np.round(np.column_stack(plane(track.origin)(x, y, inverse=True)), 7)
        properties["unit"] = "deg"
        properties["height_m"] = np.round(track.position[:, 2], 3).tolist()
    coordinates = places.tolist()
    line = len(coordinates) > 1
    geometry = {
        "type": "LineString" if line else "Point",
        "coordinates": coordinates if line else (coordinates or [[]])[0],
    }
    feature = {"type": "Feature", "properties": properties, "geometry": geometry}
    json.dump({"type": "FeatureCollection", "features": [feature]}, stream)
    stream.write("\n")


def export(track: Trajectory, kind: str, path: Path) -> Path:
    """Write the track as `kind`, an entry of `EXPORTERS`, an entry point in the group
    ``trexton.exporters`` or ``module:function``; whole or not at all.

    Raises
    ------
    ParameterError
        There is no such kind.
    """
    write = resolve("exporters", kind, EXPORTERS)
    with atomic_file(path) as stream:
        write(track, stream)
    return path
