"""``trexton check``: read a flight folder and report every fault; status 1 where it cannot be
used.
"""

from __future__ import annotations

import argparse

from trexton.flights.check import check_flight


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flight", metavar="FLIGHT", help="the folder that holds flight.toml")


def run(arguments: argparse.Namespace) -> int:
    report = check_flight(arguments.flight)
    print(report)
    return 0 if report.usable else 1
