"""``trexton report FLIGHT --out DIR``: will it work here? A printable page and a small book."""

from __future__ import annotations

import argparse
from pathlib import Path

__all__ = ["add_arguments", "run"]

SHARE = 0.6  # of a flight without splits is for training
PAGES = ("assessment", "mocap_training", "map_loss", "overview", "texton_dictionary")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("flight", metavar="FLIGHT", help="Flight folder to train on")
    parser.add_argument("--test-flight", metavar="FLIGHT", help="another Flight folder to test on")
    parser.add_argument("--out", required=True, metavar="DIR", help="where results go")
    parser.add_argument(
        "--methods", default="paper field", metavar="NAMES", help="to compare (default %(default)s)"
    )
    parser.add_argument("--no-book", action="store_true", help="the printable page only")


def run(arguments: argparse.Namespace) -> int:
    from trexton.book.report import write_report
    from trexton.commands.run import print_outcomes
    from trexton.records import Record
    from trexton.workflow import FlightPair, run_experiments

    out = Path(arguments.out)
    flight = (
        arguments.flight if arguments.test_flight else _with_splits(Path(arguments.flight), out)
    )
    pairs = [FlightPair(str(flight), arguments.test_flight)]
    outcomes = run_experiments(
        pairs,
        out,
        only=["assessment"] if arguments.no_book else list(PAGES),
        settings={"assessment.methods": arguments.methods},
    )
    print_outcomes(outcomes, explain=False)
    good = [
        each
        for each in outcomes
        if each.experiment == "assessment" and each.status in ("ran", "reused")
    ]
    if not good:
        return 1
    record = Record.load(out / pairs[0].name / "assessment.json")
    player = f"{pairs[0].name}/mocap_training-player.html"
    page = write_report(record, out / "report.html", player if (out / player).is_file() else "")
    from trexton.experiments.assessment import finding

    print(finding(record))
    if not arguments.no_book:
        from trexton.book import build_small_book

        print(build_small_book(pairs, outcomes, out))
    print(page)
    return 0


def _with_splits(source: Path, out: Path) -> Path:
    """The flight itself if it has its splits; otherwise one beside the results, of its first and
    later frames.
    """
    from dataclasses import replace

    from trexton.flights import read_flight, write_flight
    from trexton.progress import say

    flight = read_flight(source)
    if {"train", "test"} <= set(flight.split):
        return source
    last = max(1, round(SHARE * len(flight))) - 1
    numbers = flight.frame
    split = {
        "train": (int(numbers[0]), int(numbers[last])),
        "test": (int(numbers[min(last + 1, len(numbers) - 1)]), int(numbers[-1])),
    }
    say(
        f"{source} names no splits: its first {last + 1} of {len(flight)} frames train, the others "
        "test"
    )
    return write_flight(replace(flight, split=split), out / "flight" / flight.name)
