"""Where frames come from: a registry of classes that declare themselves.

The first class that matches an address makes the source; ``KIND:ADDRESS`` asks for one by name.
Adding a source is its file and its line here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from trexton.base.errors import ParameterError
from trexton.base.options import Options
from trexton.base.plugins import addresses
from trexton.onboard.edges import edge_at, edge_classes
from trexton.onboard.sources.base import CameraLost, Frame, Playback, Shape, Source
from trexton.onboard.sources.recorded import Paced

__all__ = [
    "CameraLost", "Frame", "Playback", "SOURCES", "Source", "open_source",
]  # fmt: skip

# kind: module and class, in the order in which they are asked
SOURCES = {
    "v4l2": "trexton.onboard.sources.video:V4l2Source",
    "flight": "trexton.onboard.sources.recorded:FlightSource",
    "stream": "trexton.onboard.sources.video:StreamSource",
    "video": "trexton.onboard.sources.recorded:VideoFile",
}


def open_source(
    address: str, shape: Shape = None, options: Mapping[type[Options], Any] | None = None
) -> Source:
    """The source at `address`, not yet opened.

    Parameters
    ----------
    address : str
    shape : (rows, columns), optional
        The image size to ask a camera for.
    options : mapping, optional
        An object for each class of options that differs from its defaults.

    Raises
    ------
    TrextonError
        Nothing is there, or no source understands the address.
    """
    if len(address.splitlines()) > 1:
        raise ParameterError(f"camera {address!r}: expected one line")
    try:
        addressed = edge_at("sources", address, SOURCES) if ":" in address else None
        source, rest = (addressed[0], addressed[2]) if addressed else (None, address)
        if source is None:
            edges = edge_classes("sources", SOURCES)
            source = next((each for each in edges if each.matches(address)), None)
        if source is None:
            raise ParameterError(
                f"camera {address!r} is not known: give /dev/videoN, a flight's folder, "
                "a video file or URL, or KIND:ADDRESS with KIND one of "
                + ", ".join(addresses("sources", SOURCES))
            )
        chosen = (options or {}).get(source.options, source.options())
        made: Source = source.make(rest, chosen, shape)
    except OSError as error:
        raise ParameterError(
            f"camera {address[:80]!r} cannot be read ({error.strerror or error}): check its path"
        ) from None
    pace = getattr(chosen, "pace", "fast")
    return Paced(made) if pace == "stamps" and not made.live else made
