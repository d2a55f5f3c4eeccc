"""``trexton replay LOG``"""

from __future__ import annotations

import argparse

__all__ = ["add_arguments", "run"]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", metavar="LOG", help="what trexton onboard --log wrote")


def run(arguments: argparse.Namespace) -> int:
    from trexton.onboard.logbook import events, summary

    for line in events(arguments.log):
        print(line)
    print(", ".join(f"{name} {count}" for name, count in summary(arguments.log).items()))
    return 0
