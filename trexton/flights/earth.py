"""Between metres of a flight and degrees on Earth."""

from __future__ import annotations

from typing import Any

__all__ = ["plane"]


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
