"""Where frames come from: what every source is (open, read one frame after another, close), and
the registry of classes that declare themselves.

The first class that matches an address makes the source; ``KIND:ADDRESS`` asks for one by name.
Adding a source is its file and its line here.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from trexton.base.errors import ParameterError, TrextonError
from trexton.base.options import Options, option
from trexton.base.plugins import addresses
from trexton.flights.aiding import Aiding
from trexton.onboard.edges import Edge, edge_at, edge_classes
from trexton.vision.camera import Rectification

if TYPE_CHECKING:
    from trexton.flights.flight import Flight

# kind: module and class, in the order in which they are asked
SOURCES = {
    "flight": "trexton.onboard.sources.recorded:FlightSource",
    "stream": "trexton.onboard.sources.video:StreamSource",
}

Shape = tuple[int, int] | None  # rows and columns to ask a camera for


class CameraLost(TrextonError):
    """The source gives no more frames, but may do so again once it is opened anew."""


@dataclass(frozen=True, eq=False, slots=True)
class Frame:
    """One frame as it came.

    Attributes
    ----------
    time : float
        Seconds at which it was captured.
    picture : (H, W, 3) uint8 array, (K,) array or None
        Image (Y, U, V) or histogram; None where it came but cannot be decoded.
    number : int or None
        As the flight numbers it; None where nobody does.
    aiding : Aiding or None
        What the vehicle knew at this frame, where the recording tells.
    """

    time: float
    picture: np.ndarray | None
    number: int | None = None
    aiding: Aiding | None = None

    def shifted(self, seconds: float) -> Frame:
        """The same so many seconds later."""
        aiding = None if self.aiding is None else self.aiding.shifted(seconds)
        return replace(self, time=self.time + seconds, aiding=aiding)


@dataclass(frozen=True)
class Playback(Options):
    """Recordings"""

    pace: str = option(
        "fast", "every frame as fast as possible, or at its own stamps like a live camera",
        choices=("fast", "stamps"),
    )  # fmt: skip
    laps: int = option(1, "play a recording so many times", low=1)


class Source(Edge, ABC):
    """A camera, or something that stands for one.

    A live source makes its own time: it is read in a thread, and only its newest frame is decoded.
    Any other is read frame by frame by whoever works on them, so that nothing is left out.
    """

    live = True
    rectified = False  # whether its images are already as those the map was learned from
    rectification: Rectification | None = None  # made to its images, once they are checked
    delay = 0.0  # seconds by which a live one's frames are old when they arrive
    gives: str | None = None  # "images" or "histograms", where that is known beforehand
    flight: Flight | None = None  # that is played, if any
    files: tuple[str, ...] = ()  # files and folders that are read: no output may go there
    watch: Callable[[Frame], None] | None = None  # shown each frame before it is localized

    @staticmethod
    def matches(address: str) -> bool:
        """Whether an address without a kind is of this one."""
        return False

    def open(self) -> None:  # noqa: B027 - where there is something to open
        """Begin, or begin again after a fault; raises `CameraLost` where nothing is to open."""

    @abstractmethod
    def read(self) -> Frame | None:
        """The next frame, None after the last; raises `CameraLost` where opening may help."""

    def decoded(self, frame: Frame) -> Frame:
        """A frame that was read, with its picture as it is localized.

        What takes long belongs here: a live source is read to its end without it, and only its
        newest frame is worked on.
        """
        return frame

    def close(self) -> None:
        """Let go of the device or file."""


def open_source(
    address: str, shape: Shape = None, options: Mapping[type[Options], Any] | None = None
) -> Source:
    """The source at `address`, not yet opened; raises `TrextonError` where nothing is there, or no
    source understands the address.

    Parameters
    ----------
    shape : (rows, columns), optional
        The image size to ask a camera for.
    options : mapping, optional
        An object for each class of options that differs from its defaults.
    """
    if len(address.splitlines()) > 1:
        raise ParameterError(f"camera {address!r}: expected one line")
    try:
        addressed = edge_at("sources", address, SOURCES) if ":" in address else None
        source, rest = (addressed[0], addressed[2]) if addressed else (None, address)
        if source is None:
            kinds = (edge_classes("sources", SOURCES, installed=each) for each in (False, True))
            source = next(
                (each for edges in kinds for each in edges if each.matches(address)), None
            )
        if source is None:
            raise ParameterError(
                f"camera {address!r} is not known: give /dev/videoN, a flight's folder "
                "(trexton import makes one of a video), a URL, or KIND:ADDRESS with KIND one of "
                + ", ".join(addresses("sources", SOURCES))
            )
        chosen = (options or {}).get(source.options, source.options())
        return source.make(rest, chosen, shape)
    except OSError as error:
        raise ParameterError(
            f"camera {address[:80]!r} cannot be read ({error.strerror or error}): check its path"
        ) from None
