"""``trexton replay LOG``: show what a flight of the script sent, and what the autopilot said."""

from __future__ import annotations

import argparse

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", metavar="LOG", help="what trexton onboard --log wrote")


def run(arguments: argparse.Namespace) -> int:
    from trexton.onboard.logbook import replayed

    for line in replayed(arguments.log):
        print(line)
    return 0
