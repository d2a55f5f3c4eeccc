"""``trexton export FLIGHT KIND --out FILE``: write a track for other programs, as TUM."""

from __future__ import annotations

import argparse
from pathlib import Path

from trexton.base.files import check_not_read
from trexton.base.progress import say

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    from trexton.flights.exporters import EXPORTERS

    parser.add_argument("flight", metavar="FLIGHT", help="the folder that holds flight.toml")
    parser.add_argument("kind", help=f"{', '.join(EXPORTERS)}, or module:function")
    parser.add_argument("--out", required=True, metavar="FILE", help="file to write")


def run(arguments: argparse.Namespace) -> int:
    from trexton.flights import read_flight
    from trexton.flights.exporters import export

    check_not_read(arguments.out, arguments.flight)
    flight = read_flight(arguments.flight)
    path = export(flight, arguments.kind, Path(arguments.out))
    say(f"{path}: {flight.located.sum()} positions of {flight.name}")
    return 0
