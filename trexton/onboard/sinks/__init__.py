"""Where positions go: a registry of classes that declare themselves.

An address is ``KIND`` or ``KIND:REST``. A sink is one file with its class, its address and its
options, and its line here.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from trexton.base.errors import ParameterError
from trexton.base.options import Options
from trexton.onboard.edges import load
from trexton.onboard.sinks.base import Guard, Sink, Surroundings

__all__ = ["Guard", "SINKS", "Sink", "Surroundings", "open_sink", "sink_classes"]

# kind: module and class; several kinds may share one
SINKS = {
    "json": "trexton.onboard.sinks.json_lines:JsonLines",
    "csv": "trexton.onboard.sinks.csv_table:CsvTable",
    "tum": "trexton.onboard.sinks.tum:TumTrajectory",
    "udpout": "trexton.onboard.sinks.mavlink:MavlinkSink",
    "udpin": "trexton.onboard.sinks.mavlink:MavlinkSink",
    "tcp": "trexton.onboard.sinks.mavlink:MavlinkSink",
    "serial": "trexton.onboard.sinks.mavlink:MavlinkSink",
    "paparazzi": "trexton.onboard.sinks.paparazzi:PaparazziSink",
}


def sink_classes() -> list[type[Sink]]:
    """Every registered class once."""
    return list(dict.fromkeys(load(place) for place in SINKS.values()))


def open_sink(
    address: str, around: Surroundings, options: Mapping[type[Options], Any] | None = None
) -> Sink:
    """The sink at `address`, not yet opened.

    Parameters
    ----------
    address : str
    around : Surroundings
    options : mapping, optional
        An object for each class of options that differs from its defaults.

    Raises
    ------
    ParameterError
        The kind is unknown, the address incomplete, or an extra is not installed.
    """
    kind = address.partition(":")[0]
    if kind not in SINKS:
        raise ParameterError(
            f"output {address!r} is of no known kind: "
            f"give one of {', '.join(SINKS)}, a colon and an address"
        )
    sink: type[Sink] = load(SINKS[kind])
    return sink.make(address, (options or {}).get(sink.options, sink.options()), around)
