"""Where frames come from: a registry with one small module each.

A module has ``matches(address) -> bool`` and ``make(address, options) -> Source``. The first that matches
makes the source; ``KIND:ADDRESS`` asks for one by name. Adding a source is its file and its line here.
"""

from __future__ import annotations

from importlib import import_module

from trexton.errors import ParameterError
from trexton.onboard.sources.base import CameraLost, Frame, Source, SourceOptions

__all__ = ["CameraLost", "Frame", "SOURCES", "Source", "SourceOptions", "open_source"]

# kind: module, in the order in which they are asked
SOURCES = {
    "simulator": "trexton.onboard.sources.simulator",
    "v4l2": "trexton.onboard.sources.v4l2",
    "flight": "trexton.onboard.sources.flight",
    "images": "trexton.onboard.sources.images",
    "video": "trexton.onboard.sources.video",
}


def open_source(address: str, options: SourceOptions = SourceOptions()) -> Source:
    """The source at `address`, not yet opened.

    Raises
    ------
    TrextonError
        Nothing is there, or no source understands the address.
    """
    kind, colon, rest = address.partition(":")
    if colon and kind in SOURCES:
        return import_module(SOURCES[kind]).make(rest, options)
    for module in map(import_module, SOURCES.values()):
        if module.matches(address):
            return module.make(address, options)
    raise ParameterError(
        f"camera {address!r} is not known: give /dev/videoN, a flight or image folder, a video file or URL, "
        f"simulator, or KIND:ADDRESS with KIND one of {', '.join(SOURCES)}"
    )
