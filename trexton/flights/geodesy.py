"""Between metres of a flight and degrees on Earth: a projection about a place (`plane`).

`local_metres` chooses the axes of a flight that is recorded in degrees.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from trexton.base.errors import FlightError

__all__ = ["local_metres", "plane"]


def plane(origin: tuple[float, float]) -> Any:
    """A transverse Mercator projection about a place: true to a millimetre over some kilometres.

    Parameters
    ----------
    origin : (latitude, longitude)
        Degrees (WGS 84).

    Returns
    -------
    pyproj.Proj
        Takes longitudes and latitudes to metres east and north of the place, and back with
        ``inverse=True``.
    """
    from pyproj import Proj

    return Proj(proj="tmerc", lat_0=origin[0], lon_0=origin[1], ellps="WGS84")


def local_metres(
    latitude: np.ndarray, longitude: np.ndarray
) -> tuple[np.ndarray, tuple[float, float]]:
    """``(N, 2)`` metres east and north of the south-west corner, and that corner in degrees.

    See `plane`.

    Raises
    ------
    FlightError
        A latitude or longitude is no angle on Earth.
    """
    good = (np.abs(latitude) <= 90) & (np.abs(longitude) <= 180)
    if not good.all():
        row = int(np.argmin(good))
        raise FlightError(
            f"position {row + 1} is {latitude[row]}, {longitude[row]}: expected degrees of "
            "latitude and longitude"
        )
    corner = float(latitude.min()), float(longitude.min())
    return np.column_stack(plane(corner)(longitude, latitude)), corner
