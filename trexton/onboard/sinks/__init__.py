"""Where positions go: a registry of classes that declare themselves.

An address is ``KIND`` or ``KIND:REST``. A sink is one file with its class, its address and its
options, and its line here; one of a person's own needs no line (`trexton.base.plugins`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from trexton.base.errors import ParameterError
from trexton.base.options import Options
from trexton.base.plugins import addresses
from trexton.onboard.edges import edge_at
from trexton.onboard.sinks.base import Guard, Sink, Surroundings

__all__ = ["Guard", "SINKS", "Sink", "Surroundings", "open_sink"]

# kind: module and class; several kinds may share one
SINKS = {
    "json": "trexton.onboard.sinks.files:JsonLines",
    "csv": "trexton.onboard.sinks.files:CsvTable",
    "tum": "trexton.onboard.sinks.files:TumTrajectory",
    "udpout": "trexton.onboard.sinks.mavlink:MavlinkSink",
    "udpin": "trexton.onboard.sinks.mavlink:MavlinkSink",
    "serial": "trexton.onboard.sinks.mavlink:MavlinkSink",
    "crazyflie": "trexton.onboard.sinks.crazyflie:CrazyflieSink",
}


def open_sink(
    address: str, around: Surroundings, options: Mapping[type[Options], Any] | None = None
) -> Sink:
    """The sink at `address`, not yet opened.

    Parameters
    ----------
    address : str
        ``KIND``, ``KIND:REST``, or ``module:Class:REST`` of a sink of one's own.
    around : Surroundings
    options : mapping, optional
        An object for each class of options that differs from its defaults.

    Raises
    ------
    ParameterError
        The kind is unknown, the address incomplete, or an extra is not installed.
    """
    addressed = edge_at("sinks", address, SINKS)
    if addressed is None:
        raise ParameterError(
            f"output {address!r} is of no known kind: "
            f"give one of {', '.join(addresses('sinks', SINKS))}, a colon and an address, or "
            "module:Class"
        )
    kind, name, rest = addressed
    made: Sink = kind.make(
        rest, (options or {}).get(kind.options, kind.options()), replace(around, kind=name)
    )
    return made
