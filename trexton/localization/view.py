"""In which view a frame's texture is counted, where it is not the one that the camera gave.

A tilted camera looks beside the vehicle, a higher one sees a coarser floor, a turned one sees it
turned. Where the autopilot says so, the frame is warped into the view that a camera would have
straight below the vehicle (plane-to-plane homography [1]_), at the height of the training flight.

.. [1] R. Hartley, A. Zisserman, "Multiple View Geometry in Computer Vision", 2nd ed., sec. 2.3.
"""

from __future__ import annotations

import inspect
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self
from uuid import uuid4

import cv2
import numpy as np

from trexton.base.files import digest
from trexton.base.options import option
from trexton.flights.aiding import Aiding
from trexton.flights.flight import Flight
from trexton.flights.frames import Frames
from trexton.localization.base import Part, learned
from trexton.localization.lens import believable, camera_of, check_lens, known_or, learned_lens

__all__ = ["Nadir", "View"]

_ADVICE = "train without a view from straight above"


@dataclass(eq=False)
class View(Part):
    """Another view of every frame, in training and in flight."""

    @property
    def asks(self) -> tuple[str, ...]:
        """What of an `Aiding` it takes."""
        return ("roll", "pitch", "height")

    def of(self, flight: Flight) -> Self:
        """The view as it learned what it needs of a training flight."""
        raise NotImplementedError

    def frame(self, image: np.ndarray, aiding: Aiding) -> np.ndarray:
        """``(H, W, 3) uint8``: a frame in this view, as far as `aiding` knows."""
        raise NotImplementedError

    def flight(self, flight: Flight) -> Flight:
        """The flight with its frames in this view."""
        if flight.frames is None:
            return flight
        aiding = [flight.aiding(row) for row in range(len(flight))]
        return replace(flight, frames=_Seen(flight.frames, self, aiding))

    def untrained(self) -> Self:
        """Itself: what it learned is in the histograms."""
        return self


@dataclass(eq=False)
class Nadir(View):
    """The view straight down from the training flight's usual height.

    What lies outside the picture is mirrored at its border; what the autopilot does not say is
    taken as in a level flight at that height.
    """

    turn: bool = option(
        False, "turn the picture back by the yaw as well, so that its top is the map's y axis"
    )
    camera: Any = learned()  # width, height, focal length, principal point, usual height

    @property
    def asks(self) -> tuple[str, ...]:
        return (*super().asks, "yaw") if self.turn else super().asks

    def prepare(self) -> None:
        check_lens(self.camera, "a nadir view's")

    def of(self, flight: Flight) -> Self:
        """The view as it learned the camera and the usual height of a flight.

        Raises
        ------
        MapError
            The flight lacks images, attitudes, heights above the floor, or its camera, or that
            takes pictures of another size.
        """
        return self.with_learned(camera=learned_lens(flight, _ADVICE, attitudes=True))

    def frame(self, image: np.ndarray, aiding: Aiding) -> np.ndarray:
        """``(H, W, 3) uint8``: a frame from straight above, as far as `aiding` knows."""
        camera, usual = camera_of(self.camera)
        tilt = np.array([known_or(aiding.roll, 0.0), known_or(aiding.pitch, 0.0)])
        yaw = known_or(aiding.yaw, 0.0) if self.turn else 0.0
        above = known_or(aiding.height, usual)
        changes = tilt.any() or yaw or above != usual
        if not changes or not believable(tilt, above, usual):
            return image
        level = camera.world_from_pixel(np.array([0, 0, usual]), np.zeros(3))
        seen = camera.world_from_pixel(np.array([0, 0, above]), np.array([*tilt, yaw]))
        return cv2.warpPerspective(
            image, np.linalg.solve(seen, level), image.shape[1::-1],
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP, borderMode=cv2.BORDER_REFLECT_101,
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class _Seen:
    """Frames in another view."""

    frames: Frames
    view: View
    aiding: list[Aiding]

    def __len__(self) -> int:
        return len(self.frames)

    def __getitem__(self, row: int) -> np.ndarray:
        return self.view.frame(self.frames[row], self.aiding[row])

    @cached_property
    def digest(self) -> str:
        from trexton.base.cache import code_hashes  # which an onboard computer never needs

        kind = type(self.view)
        measured = [(each.roll, each.pitch, each.yaw, each.height) for each in self.aiding]
        return digest(
            self.frames.digest, kind.__qualname__, code_hashes(__name__),
            code_hashes(kind.__module__) or _own_code(kind), self.view.as_dict(),
            np.array(measured, dtype=float), *self.view.arrays().values(),
        )  # fmt: skip


def _own_code(kind: type[View]) -> Path | str:
    """What tells the code of a view outside the library apart."""
    try:
        return Path(inspect.getfile(kind))
    except (OSError, TypeError):  # typed into a session: what it counted is not found again
        return uuid4().hex
