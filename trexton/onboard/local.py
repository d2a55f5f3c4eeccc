"""From the map's axes to the local frames of autopilots: north, east, down; or east, north, up."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

__all__ = ["LocalFrame", "decoupled", "largest_deviation"]


@dataclass(frozen=True)
class LocalFrame:
    """How the map lies on the ground; its origin is the local origin.

    Attributes
    ----------
    heading : float
        Radians from north, clockwise, of the map's +y axis (as a compass shows it when looking
        along it).
    height : float
        Metres the camera flies above the floor: the method holds it constant and does not estimate
        it.
    """

    heading: float = 0.0
    height: float = 1.0

    @property
    def ned_from_map(self) -> np.ndarray:
        """``(2, 2)`` matrix from map x, y to north, east."""
        sine, cosine = np.sin(self.heading), np.cos(self.heading)
        return np.array([[-sine, cosine], [cosine, sine]])

    def ned(self, position: np.ndarray) -> np.ndarray:
        """``(3,)`` north, east, down in metres of a ``(2,)`` map position."""
        return np.append(self.ned_from_map @ position, -self.height)

    def ned_covariance(self, covariance: np.ndarray) -> np.ndarray:
        """``(2, 2)`` covariance of north and east from that of map x and y."""
        turned: np.ndarray = self.ned_from_map @ covariance @ self.ned_from_map.T
        return turned

    def yaw(self, heading: float) -> float:
        """Radians from north, clockwise, within a half turn, of a heading counted anticlockwise
        from the map's +y."""
        return float(np.arctan2(np.sin(self.heading - heading), np.cos(self.heading - heading)))

    def enu(self, position: np.ndarray) -> np.ndarray:
        """``(3,)`` east, north, up in metres of a ``(2,)`` map position."""
        north, east, down = self.ned(position)
        return np.array([east, north, -down])


def decoupled(covariance: np.ndarray) -> np.ndarray:
    """The ``(2, 2)`` covariance with its correlation added to both variances.

    Autopilots fuse the diagonal alone. Taken alone, the diagonal of a correlated cloud claims too
    much across its long axis; this diagonal is at least the covariance in every direction, and so
    is the matrix with its correlation kept.
    """
    bound: np.ndarray = covariance + abs(covariance[0, 1]) * np.eye(2)
    return bound


def largest_deviation(covariance: np.ndarray) -> float:
    """The larger standard deviation of a `decoupled` covariance, for one number of accuracy."""
    return float(np.sqrt(np.diagonal(decoupled(covariance)).max()))
