"""``trexton book``: flights, experiments and pages of the book. What has not changed is reused."""

import argparse
import time

from trexton.base.arguments import assignments
from trexton.companion.build.make import make_book
from trexton.companion.cli.run import add_run_arguments, print_outcomes


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_run_arguments(parser)
    words = "the first page, one experiment with its player, and its ledger, in book/_build/quick"
    parser.add_argument("--quick", action="store_true", help=words)


def run(arguments: argparse.Namespace) -> int:
    started = time.monotonic()
    settings = assignments(arguments.settings, "key=value")
    made = make_book(settings=settings, jobs=arguments.jobs, quick=arguments.quick)
    print_outcomes(made.outcomes, arguments.explain)
    for sentence in made.said:
        print(sentence)
    seconds = time.monotonic() - started
    print(f"\nThe book, made in {seconds:.0f} s: open {made.index} in a browser.")
    for sentence in made.findings:
        print(f"- {sentence}")
    return int(made.failed)
