"""How the middle of the view moves over the floor, by fixes and odometry: `ViewMotion`.

Where the two contradict each other, the belief is widened, so that the floor says which is right.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["KNOWN", "ViewMotion"]

Array = NDArray[Any]

_SURE = 0.15  # certainty of the odometry from which it is believed
_PLAIN = 0.5  # from which it is taken against the motion before; prints that repeat reach less
_JUMP = 2.0  # cells a frame by which a motion may differ from the one before
KNOWN, _ROUGH, _UNKNOWN = 0.4, 0.5, 2.0  # cells: what a step adds to the belief's width
_STRAYS = 0.6  # cells a frame: the error of going on as before
_MEMORY = 10.0  # frames over which it is taken how far the view moves


class ViewMotion:
    """The floor point in the image centre, and how fast it moves.

    Parameters
    ----------
    cell : float
        Side of a cell in metres.
    longest : float
        Cells: a longer motion from frame to frame is a jump.

    Attributes
    ----------
    aimed : (2,) array
        That point in the last frame that was found, metres.
    velocity : (2,) array or None
        Cells a frame (column, row), where it is known.
    """

    def __init__(self, cell: float, longest: float):
        self.cell, self.longest = cell, longest
        self.aimed = self._before = np.zeros(2)
        self.velocity: Array | None = None
        self._reach = 0.0  # cells: how far it moves from frame to frame

    def predicted(
        self, shift: Array, last: Array | None, sure: float, steps: int
    ) -> tuple[Array, float]:
        """``(K, 2)`` cells by which the view moved, one row a heading, and their deviation.

        Parameters
        ----------
        shift : (K, 2) array
            The same by odometry.
        last : (2,) array or None
            By odometry under the heading of the last pose; None where it is not known.
        sure : float
            The odometry's certainty.
        steps : int
            Frames since the last that came.
        """
        if self.velocity is not None and last is not None:
            going = steps * self.velocity
            jump = float(np.hypot(*(last - going)))
            if sure < (_PLAIN if jump > _JUMP else _SURE):
                return np.tile(going, (len(shift), 1)), _ROUGH * steps**1.5
            # Where one of the two is wrong, the floor says which.
            return shift, jump if jump > _JUMP else KNOWN
        if sure < _SURE:
            return np.zeros_like(shift), max(_UNKNOWN, self._reach) * steps
        return shift, KNOWN

    def aim(self, place: Array) -> None:
        """A frame was found to show this point, metres, in its middle."""
        self._before, self.aimed = self.aimed, place

    def learn(self, frames: int) -> None:
        """Take the velocity from the last two points, so many frames apart."""
        moved = (self.aimed - self._before) / frames
        cells = moved / self.cell * (1, -1)
        length = float(np.hypot(*cells))
        self.velocity = cells if length < self.longest / 4 else None
        self._reach += (min(length, self.longest) - self._reach) / _MEMORY

    def ahead(self, frames: int) -> tuple[Array, float]:
        """``(2,)`` metres that the view moves in so many frames; cells a frame it may be off."""
        if self.velocity is None:
            return np.zeros(2), max(_UNKNOWN, self._reach)
        return frames * self.cell * self.velocity * (1, -1), _STRAYS
