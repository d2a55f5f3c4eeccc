"""``trexton check``: every fault of a flight folder is reported. Status 1 if it is unusable."""

import argparse

from trexton.base.errors import ParameterError
from trexton.flights.check import check_flight, repair_flight


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flight", metavar="FLIGHT", help="the folder that holds flight.toml")
    parser.add_argument("--repair", action="store_true", help="do what warnings advise, in a copy")
    parser.add_argument("--out", metavar="FLIGHT", help="where the repaired flight is written")
    parser.add_argument("--replace", action="store_true", help="replace the Flight folder there")


def run(arguments: argparse.Namespace) -> int:
    if arguments.repair != bool(arguments.out):
        raise ParameterError("--repair and --out go together: the original is kept, name a folder")
    folder = arguments.out or arguments.flight
    if arguments.repair:
        for line in repair_flight(arguments.flight, folder, arguments.replace):
            print(f"repair   {line}")
    report = check_flight(folder)
    print(report)
    return 0 if report.usable else 1
