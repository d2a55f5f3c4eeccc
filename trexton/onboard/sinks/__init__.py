"""Where positions go: a registry with one small module each.

A module has ``make(address, options) -> Sink``. An address is ``KIND`` or ``KIND:REST``; adding a sink is its
file and its line here.
"""

from __future__ import annotations

from importlib import import_module

from trexton.errors import ParameterError
from trexton.onboard.sinks.base import Guard, Sink, SinkOptions

__all__ = ["Guard", "SINKS", "Sink", "SinkOptions", "open_sink"]

# kind: module; several kinds may share one
SINKS = {
    "json": "trexton.onboard.sinks.json_lines",
    "csv": "trexton.onboard.sinks.csv_table",
    "tum": "trexton.onboard.sinks.tum",
    "udpout": "trexton.onboard.sinks.mavlink",
    "udpin": "trexton.onboard.sinks.mavlink",
    "tcp": "trexton.onboard.sinks.mavlink",
    "serial": "trexton.onboard.sinks.mavlink",
    "paparazzi": "trexton.onboard.sinks.paparazzi",
}


def open_sink(address: str, options: SinkOptions) -> Sink:
    """The sink at `address`, not yet opened.

    Raises
    ------
    ParameterError
        The kind is unknown, the address incomplete, or an extra is not installed.
    """
    kind = address.partition(":")[0]
    if kind not in SINKS:
        raise ParameterError(
            f"output {address!r} is of no known kind: give one of {', '.join(SINKS)}, a colon and an address"
        )
    return import_module(SINKS[kind]).make(address, options)
