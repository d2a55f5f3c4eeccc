"""Where frames come from: a registry of classes that declare themselves.

The first class that matches an address makes the source; ``KIND:ADDRESS`` asks for one by name.
Adding a source is its file and its line here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from trexton.base.errors import ParameterError
from trexton.base.options import Options
from trexton.onboard.edges import load
from trexton.onboard.sources.base import CameraLost, Frame, Playback, Source, View
from trexton.onboard.sources.wrapped import Delayed, Rectified

__all__ = [
    "CameraLost", "Delayed", "Frame", "Playback", "Rectified", "SOURCES", "Source", "View",
    "open_source", "source_classes",
]  # fmt: skip

# kind: module and class, in the order in which they are asked
SOURCES = {
    "simulator": "trexton.onboard.sources.simulator:SimulatorSource",
    "v4l2": "trexton.onboard.sources.v4l2:V4l2Source",
    "flight": "trexton.onboard.sources.flight:FlightSource",
    "images": "trexton.onboard.sources.images:ImageFolder",
    "stream": "trexton.onboard.sources.video:StreamSource",
    "video": "trexton.onboard.sources.video:VideoFile",
}


def source_classes() -> list[type[Source]]:
    """Every registered class once."""
    return list(dict.fromkeys(load(place) for place in SOURCES.values()))


def open_source(
    address: str, view: View | None = None, options: Mapping[type[Options], Any] | None = None
) -> Source:
    """The source at `address`, not yet opened.

    Parameters
    ----------
    address : str
    view : View, optional
    options : mapping, optional
        An object for each class of options that differs from its defaults.

    Raises
    ------
    TrextonError
        Nothing is there, or no source understands the address.
    """
    try:
        return _made(address, view or View(), options or {})
    except OSError as error:
        raise ParameterError(
            f"camera {address[:80]!r} cannot be read ({error.strerror or error}): check its path"
        ) from None


def _made(address: str, view: View, options: Mapping[type[Options], Any]) -> Source:
    if len(address.splitlines()) > 1:
        raise ParameterError(f"camera {address!r}: expected one line")
    kind, colon, rest = address.partition(":")
    if colon and kind in SOURCES:
        candidates = [(load(SOURCES[kind]), rest)]
    else:
        candidates = [(load(place), address) for place in SOURCES.values()]
        candidates = [(source, words) for source, words in candidates if source.matches(words)]
    for source, words in candidates[:1]:
        made: Source = source.make(words, options.get(source.options, source.options()), view)
        return made
    raise ParameterError(
        f"camera {address!r} is not known: give /dev/videoN, a flight or image folder, "
        f"a video file or URL, simulator, or KIND:ADDRESS with KIND one of {', '.join(SOURCES)}"
    )
