"""CSV: ``t_s,x_m,y_m,z_m,yaw_rad`` with all digits."""

from __future__ import annotations

from typing import IO

from trexton.flights.exporters import Trajectory

__all__ = ["write"]


def write(track: Trajectory, stream: IO[str]) -> None:
    """A header and one line a position."""
    stream.write("t_s,x_m,y_m,z_m,yaw_rad\n")
    for time, place, yaw in zip(track.time, track.position, track.yaw, strict=True):
        stream.write(",".join(repr(float(number)) for number in (time, *place, yaw)) + "\n")
