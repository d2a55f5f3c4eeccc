"""``trexton book``: flights, experiments and pages of the book. What has not changed is reused."""

import argparse
import time
from pathlib import Path

from trexton.base.arguments import assignments
from trexton.base.cache import repository_root
from trexton.companion.build.unchanged import MADE, Unchanged
from trexton.companion.cli.run import add_run_arguments, print_outcomes


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_run_arguments(parser)
    words = "the first page, one experiment with its player, and its ledger, in book/_build/quick"
    parser.add_argument("--quick", action="store_true", help=words)


def run(arguments: argparse.Namespace) -> int:
    started, root = time.monotonic(), repository_root() or Path()
    settings = assignments(arguments.settings, "key=value")
    left, asked = [root / name for name in MADE], [settings, arguments.quick]
    before = Unchanged(left[-1] / ".unchanged", asked, (), left)
    if not arguments.explain and (sentences := before.last()):
        print("Nothing has changed since the book was made:", *sentences, sep="\n")
        return 0
    from trexton.companion.build.make import make_book

    made = make_book(settings=settings, jobs=arguments.jobs, quick=arguments.quick)
    print_outcomes(made.outcomes, arguments.explain)
    for sentence in made.said:
        print(sentence)
    sentences = [f"open {made.index} in a browser.", *(f"- {each}" for each in made.findings)]
    print(f"\nThe book, made in {time.monotonic() - started:.0f} s:", *sentences, sep="\n")
    if made.whole and not made.failed:
        before.remember(sentences)
    return int(made.failed)
