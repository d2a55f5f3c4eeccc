"""TUM: ``stamp x y z qx qy qz qw``, seconds and metres, as evo reads it."""

from __future__ import annotations

from typing import IO

import numpy as np

from trexton.flights.exporters import Trajectory

__all__ = ["write"]


def write(track: Trajectory, stream: IO[str]) -> None:
    """One line a position; the quaternion turns a vehicle whose x points forward (REP 103)."""
    # A vehicle of yaw 0 flies along y (`trexton.vision.camera`).
    for time, place, yaw in zip(track.time, track.position, track.yaw + np.pi / 2, strict=True):
        numbers = (time, *place, 0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2))
        stream.write(" ".join(f"{number:.9f}" for number in numbers) + "\n")
