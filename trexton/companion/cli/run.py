"""``trexton run``: the experiments on a flight. They leave records, figures and a small book."""

import argparse
import sys
from collections import Counter
from pathlib import Path

from trexton.base.arguments import add_assignments, assignments
from trexton.base.errors import ParameterError
from trexton.companion.build.display import Outcome


def add_arguments(parser: argparse.ArgumentParser) -> None:
    words = "Flight folders to train on (and to test on, by their splits)"
    parser.add_argument("flights", nargs="+", metavar="FLIGHT", help=words)
    parser.add_argument("--test-flight", metavar="FLIGHT", help="another Flight folder to test on")
    parser.add_argument("--out", required=True, metavar="DIR", help="where results go")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="these experiments only")
    add_run_arguments(parser)
    parser.add_argument("--notebooks", metavar="DIR", help="another folder of notebooks")
    parser.add_argument("--no-book", action="store_true", help="leave out the small book")


def add_run_arguments(parser: argparse.ArgumentParser) -> None:
    """What every verb that runs notebooks takes: ``--set``, ``--explain``, ``--jobs``."""
    words = "a parameter of the notebooks, or of one: mocap_training.samples=200"
    add_assignments(parser, "KEY=VALUE", words)
    words = "say why each experiment was reused or run"
    parser.add_argument("--explain", action="store_true", help=words)
    words = "notebooks at once (default: as many as fit this machine)"
    parser.add_argument("--jobs", type=int, metavar="N", help=words)


def run(arguments: argparse.Namespace) -> int:
    from trexton.companion.build.flight_pairs import FlightPair
    from trexton.companion.build.plan import run_experiments

    if arguments.test_flight is not None and len(arguments.flights) > 1:
        raise ParameterError("--test-flight belongs to one flight: run the others by themselves")
    pairs = [FlightPair(flight, arguments.test_flight) for flight in arguments.flights]
    outcomes = run_experiments(
        pairs,
        arguments.out,
        only=arguments.only,
        settings=assignments(arguments.settings, "key=value"),
        jobs=arguments.jobs,
        notebooks=arguments.notebooks,
    )
    print_outcomes(outcomes, arguments.explain)
    if not arguments.no_book and any(outcome.status in ("ran", "reused") for outcome in outcomes):
        from trexton.companion.build.make import build_small_book

        print(build_small_book(pairs, outcomes, Path(arguments.out)))
    return int(any(outcome.status == "failed" for outcome in outcomes))


def print_outcomes(outcomes: list[Outcome], explain: bool) -> None:
    """One line an experiment; reasons where it failed or was skipped, or everywhere (`explain`).
    What failed goes to stderr.
    """
    for outcome in outcomes:
        stream = sys.stderr if outcome.status == "failed" else sys.stdout
        print(outcome, file=stream)
        if explain or outcome.status in ("failed", "skipped"):
            for reason in outcome.reasons:
                print(f"        {reason}", file=stream)
    counts = Counter(outcome.status for outcome in outcomes)
    order = ("ran", "reused", "skipped", "failed")
    print(", ".join(f"{counts[status]} {status}" for status in order if counts[status]))
